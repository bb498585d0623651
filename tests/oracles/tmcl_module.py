"""A module built from PyTrinamic's own frames, whose motors arrive at once. Prints its port, then answers until its input ends."""
import os
import select
import sys
import tty
from pytrinamic.tmcl import TMCLCommand, TMCLReply, TMCLRequest, TMCLStatus

ACTUAL, SPEED, RESOLUTION = 1, 3, 140
axes = [{ACTUAL: 77, SPEED: 0, 4: 3200, 5: 32000, RESOLUTION: 5} for _ in range(2)]
variables = {}


def signed(value):
    return value - (1 << 32) if value >> 31 else value


def carry_out(r):
    command, kind, motor = r.command, r.commandType, r.motorBank
    if command == TMCLCommand.GET_FIRMWARE_VERSION and kind == 1:
        return 0x18440100
    if command == TMCLCommand.SGP:
        variables[kind, motor] = r.value
    if command in (TMCLCommand.SGP, TMCLCommand.GGP):
        return variables.get((kind, motor), 0)
    if command == TMCLCommand.GAP:
        return axes[motor][kind]
    if command == TMCLCommand.SAP:
        axes[motor][kind] = signed(r.value)
    elif command == TMCLCommand.MVP and kind == 0:
        axes[motor][ACTUAL] = signed(r.value)
        print(f"motor {motor} to {signed(r.value)}", flush=True)
    elif command != TMCLCommand.MST:
        raise ValueError(str(r))
    return r.value


master, slave = os.openpty()
tty.setraw(slave)
print(os.ttyname(slave), flush=True)
heard = b""
while True:
    ready, _, _ = select.select([master, sys.stdin], [], [])
    if sys.stdin in ready:
        break
    heard += os.read(master, 4096)
    while len(heard) >= 9:
        request, heard = TMCLRequest.from_buffer(heard[:9]), heard[9:]
        intact = TMCLRequest(request.moduleAddress, request.command, request.commandType, request.motorBank, request.value)
        assert intact.to_buffer() == request.to_buffer(), f"the checksum of {request} should be {intact.checksum:02x}"
        reply = TMCLReply(2, request.moduleAddress, TMCLStatus.SUCCESS, request.command, carry_out(request))
        os.write(master, reply.to_buffer())
