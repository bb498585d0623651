"""PyTrinamic controls the emulated module with Trinamic's own TMCL. Argument: the port."""
import sys
from pytrinamic.connections.serial_tmcl_interface import SerialTmclInterface
from pytrinamic.tmcl import TMCLReplyStatusError

TARGET, ACTUAL, SPEED, MAX_SPEED, RESOLUTION = 0, 1, 3, 4, 140
module = SerialTmclInterface(sys.argv[1], datarate=115200, host_id=2, module_id=1)
assert module.get_axis_parameter(RESOLUTION, 0) == 5
assert module.get_axis_parameter(MAX_SPEED, 1) == 3200
for motor in (0, 1):
    module.move_to(motor, -640)
# The motor has arrived and is at rest: shortly before, its position already has the target's number while it still
# moves.
while any(
    (module.get_axis_parameter(ACTUAL, motor, signed=True), module.get_axis_parameter(SPEED, motor, signed=True)) != (-640, 0)
    for motor in (0, 1)
):
    pass
assert module.get_axis_parameter(TARGET, 0, signed=True) == -640
module.set_global_parameter(55, 2, 7)
assert module.get_global_parameter(55, 2) == 7
module.stop(0)
try:
    module.get_axis_parameter(99, 0)
    sys.exit("parameter 99 was answered")
except TMCLReplyStatusError as refused:
    assert refused.status_code == 3, refused.status_code
