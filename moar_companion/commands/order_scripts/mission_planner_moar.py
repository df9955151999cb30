"""Orders to moar-companion from Mission Planner, for one site: a window with a button for each.

Written by `moar-companion site actions`. In Mission Planner: Data, tab Scripts, Select Script, Run
Script. Closing the window ends the script.

The orders go to the companion's component alone. In the list of vehicles (top right) leave the
autopilot selected: with the companion selected, Mission Planner's modes do not reach the autopilot.
"""

import clr

clr.AddReference("MAVLink")
clr.AddReference("System.Drawing")
clr.AddReference("System.Windows.Forms")
import MAVLink
from System import Byte, Single
from System.Drawing import Size
from System.Windows.Forms import Button, DockStyle, FlowDirection, FlowLayoutPanel, Form, Label

SITE, COMPONENT, ORDERS = "", 195, ()

WIDTH, HEIGHT = 360, 32
"""Of a button, in pixels."""
COMMANDS = {193: MAVLink.MAV_CMD.DO_PAUSE_CONTINUE, 31010: MAVLink.MAV_CMD.USER_1}


def answer_to(order):
    """Sends an order, which Mission Planner repeats until the answer; returns a line of text."""
    label, _, _, command, param1, param2 = order
    ids = [Byte(MAV.MAV.sysid), Byte(COMPONENT), COMMANDS[command]]
    params = [Single(value) for value in (param1, param2, 0, 0, 0, 0, 0)]
    try:
        accepted = MAV.doCommand(*(ids + params))  # MAV: Mission Planner's connection
    except Exception as error:
        return "%s: no answer (%s)" % (label, str(error).split("\n")[0])
    return "%s: %s" % (label, "accepted" if accepted else "not accepted, see Messages")


def add_button(panel, order, status):
    """Adds the button of an order; its answer is shown in the status line."""

    def clicked(_sender, _event):
        status.Text = order[0] + ": sent"
        status.Refresh()
        status.Text = answer_to(order)

    button = Button()
    button.Text = order[0]
    button.UseMnemonic = False
    button.AutoEllipsis = True
    button.Size = Size(WIDTH, HEIGHT)
    button.Click += clicked
    panel.Controls.Add(button)


def window():
    """The window with all orders."""
    form, panel, status = Form(), FlowLayoutPanel(), Label()
    form.Text = "moar-companion: " + SITE
    form.ClientSize = Size(WIDTH + 40, 480)
    form.TopMost = True
    panel.Dock = DockStyle.Fill
    panel.FlowDirection = FlowDirection.TopDown
    panel.WrapContents = False
    panel.AutoScroll = True
    status.Dock = DockStyle.Bottom
    status.Height = 2 * HEIGHT
    status.UseMnemonic = False
    status.Text = "An order is sent at once. To take over, select another mode."
    for order in ORDERS:
        add_button(panel, order, status)
    form.Controls.Add(panel)
    form.Controls.Add(status)
    return form


window().ShowDialog()
