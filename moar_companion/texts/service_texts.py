"""Texts for pilots about the service itself: its start, its files, its links.

The rest of the table, and its form: `pilot_texts`.
"""

from __future__ import annotations

from collections.abc import Mapping

from .text_patterns import PilotText

# Start and files

RESTARTED = PilotText(
    pattern="restarted, was {before}",
    meaning="the service was restarted during a mission, or in flight",
    remedy="let the pilot fly on; order `continue` or a mission",
)
CONTINUE_POSSIBLE = PilotText(
    pattern="order continue to fly the rest",
    meaning="the mission that a restart or a passing cause has interrupted is kept",
    remedy="order `continue`",
)
SERVICE_ENDS = PilotText(
    pattern="the service ends",
    actions=("released", "failed"),
    meaning="the companion's process is stopped; open orders fail",
    remedy="fly on by hand; after its start order `continue` or a mission",
)
MODE_STILL_ON = PilotText(
    pattern="{own_mode} is on, waiting for an order",
    meaning="after a restart in flight the autopilot still is in our mode",
    remedy="order a mission, or take over",
)
COMPILING = PilotText(
    pattern="compiling planner: {parts} of {total}",
    actions=("", "rejected"),
    meaning="the planner is compiled for this computer, once",
    remedy="wait; until then only a hold or a release is executed",
)
PLANNER_READY = PilotText(
    pattern="the planner is ready",
    meaning="the compilation has ended",
)
NO_STATE_FILE = PilotText(
    pattern="no state file: {fault}",
    actions=("restart goes idle", "over"),
    meaning="the mission's state cannot be written",
    remedy="free or mount the disk; after a restart order anew",
)
STATE_UNREADABLE = PilotText(
    pattern="state file unreadable",
    actions=("starting idle", "over"),
    meaning="the state of the process before cannot be read",
    remedy="order anew",
)
STATE_UNUSABLE = PilotText(
    pattern="state file unusable",
    actions=("starting idle", "over"),
    meaning="the state file is damaged, or of another version",
    remedy="order anew",
)
PARAMETERS_UNREADABLE = PilotText(
    pattern="parameter file unreadable",
    actions=("files count", "over"),
    meaning="what was set in flight before the start cannot be read: the files' settings count",
    remedy="correct the file's rights, and restart; or set the parameters again",
)
PARAMETERS_UNUSABLE = PilotText(
    pattern="parameter file unusable",
    actions=("files count", "over"),
    meaning="that file is damaged, or of another version: it is put aside",
    remedy="set the parameters again",
)
STORED_INVALID = PilotText(
    pattern="{count} stored parameter{plural} not valid",
    actions=("dropped", "over"),
    meaning="values that were set in flight are not permitted beside the files any more: the log "
    "has each",
    remedy="set them again",
)
NO_PARAMETER_FILE = PilotText(
    pattern="no parameter file: {fault}",
    actions=("not kept", "over"),
    meaning="parameters that are set now cannot be kept for the next start",
    remedy="free or mount the disk",
)
RECORDING_ENDED = PilotText(
    pattern="recording ended: {fault}",
    actions=("flying on", "over"),
    meaning="the flight is no longer recorded",
    remedy="free or mount the disk",
)

# Links

TWO_AUTOPILOTS = PilotText(
    pattern="two autopilots, ids {id} and {other_id}",
    actions=("no control",),
    meaning="two autopilots are received",
    remedy="separate the links, or switch one off",
)
TWO_CLOCKS = PilotText(
    pattern="two clocks, autopilot id {id}",
    actions=("no control",),
    meaning="two autopilots with the same id are received",
    remedy="separate the links, or switch one off",
)
TWO_COMPANIONS = PilotText(
    pattern="two companions with component id {id}",
    meaning="another sender has the companion's ids: a second companion, or `check` on this link",
    remedy="stop one, or give it another `component_id`",
)
AUTOPILOT_ELSEWHERE = PilotText(
    pattern="autopilot also at {host}",
    actions=("ignored",),
    meaning="packets with the autopilot's id come from another address, too",
    remedy="see that only one sender is on the link",
)
DATAGRAMS_DROPPED = PilotText(
    pattern="{large_count} datagram{plural} too many",
    actions=("dropped",),
    meaning="a sender floods a link; the autopilot's packets are all read",
    remedy="find the sender; the log has the link",
)
PACKETS_REFUSED = PilotText(
    pattern="{large_count} packet{plural} refused: {refusal}",
    meaning="packets on a signed link without the key, with a wrong one, or too old",
    remedy="sign with the vehicle's key; set the sender's clock",
)
SIGNER_BEHIND = PilotText(
    pattern="system {id} signs {s} s behind",
    meaning="the clock of that sender is behind: its packets are refused",
    remedy="set its clock",
)
SIGNING_AHEAD = PilotText(
    pattern="signing.json {time} ahead of the clock",
    meaning="the kept time stamps are ahead of this computer's clock: new senders are refused",
    remedy="set this computer's clock; where it is right, stop the service and delete the file",
)


TEXTS: Mapping[str, PilotText] = {
    name: text for name, text in globals().items() if isinstance(text, PilotText)
}
"""All of them by name, in this order."""
