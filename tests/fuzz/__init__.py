"""Hostile input for the companion: bytes, messages with hostile fields, coverage-guided.

    .venv/bin/python -m tests.fuzz bytes [COUNT] [--lives FIRST:END]      10^7 bytes
    .venv/bin/python -m tests.fuzz messages [COUNT] [--lives FIRST:END]   2 * 10^6 messages
    .venv/bin/python -m tests.fuzz services [COUNT]                       10^6 requests
    .venv/bin/python -m tests.fuzz coverage [SECONDS]                     900 s; extra `fuzz`

`flights` feeds the whole companion in flight beside the fake autopilots and judges every cycle;
`services` floods the services for ground stations beside a session without requests;
`coverage` feeds codec and session alone. The exit status is 1 after a finding.
"""
