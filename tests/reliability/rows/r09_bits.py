"""R9: one bit of one stored frame is flipped. `carved measure` must refuse the recording and name the view."""

from __future__ import annotations

import subprocess

from ..kit.recorded import recorded_run
from ..kit.row import Context, Observed, Row


def run(context: Context) -> Observed:
    """Flips `count` bits, one at a time."""
    observed = Observed("")
    well = recorded_run(context) / "A01"
    frames = sorted((well / "frames").glob("view_*.png"))
    caught = named = 0
    for n in range(context.count):
        frame = context.random.choice(frames)
        kept = frame.read_bytes()
        at, bit = context.random.randrange(len(kept)), context.random.randrange(8)
        changed = bytearray(kept)
        if not context.control:
            changed[at] ^= 1 << bit
        frame.write_bytes(changed)
        try:
            done = subprocess.run([context.binary, "measure", well], capture_output=True, text=True, timeout=300)
        finally:
            frame.write_bytes(kept)
        said = done.stdout + done.stderr
        where = f"bit {bit} of byte {at} of {frame.name}"
        caught += done.returncode != 0
        named += done.returncode != 0 and (frame.name in said or frame.stem in said)
        observed.expect(done.returncode != 0, f"{where}: not caught")
        observed.expect(done.returncode == 0 or frame.stem in said, f"{where}: caught, not named: {said[:200]}")
        observed.expect("panicked" not in said, f"{where}: panic")
        if n % 50 == 49:
            context.say(f"{n + 1} flips, {named} named")
    observed.done = f"{context.count} single bits flipped in {len(frames)} stored frames, each measured again"
    observed.figures.append(f"{caught} of {context.count} caught, {named} named")
    return observed


ROW = Row(
    "R9",
    "recorded view with one bit flipped",
    "100 % caught by hash, named",
    (3, 200, 10_000),
    "flips",
    "the frame is written back without a flip",
    r"not caught$",
    run,
)
