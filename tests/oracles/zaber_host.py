"""Zaber's Motion Library controls the emulated controller. Argument: the port."""
import sys
from zaber_motion import CommandFailedException
from zaber_motion.ascii import Connection

with Connection.open_serial_port(sys.argv[1], 115200) as connection:
    connection.enable_alerts()
    device = connection.get_device(1)
    # Checksums in both directions from here on: the library refuses an answer with a wrong one.
    device.generic_command("set comm.checksum 1")
    axis = device.get_axis(1)
    assert axis.generic_command("get resolution").data == "32"
    axis.generic_command("home")
    axis.wait_until_idle(throw_error_on_fault=True)
    axis.generic_command("move abs 1600")
    axis.wait_until_idle(throw_error_on_fault=True)
    assert int(axis.generic_command("get pos").data) == 1600
    assert abs(int(axis.generic_command("get encoder.pos").data) - 1600) <= 1
    state = axis.generic_command("")
    assert (state.status, state.warning_flag) == ("IDLE", "--"), state
    try:
        axis.generic_command("dance")
        sys.exit("an unknown command was accepted")
    except CommandFailedException as refused:
        assert refused.details.response_data == "BADCOMMAND", refused.details
