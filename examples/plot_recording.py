"""Draw a recording of `yahboomd record`: the path, the wheels, the battery and the events.

python examples/plot_recording.py run1 [run1.png]     (pip install matplotlib 'mcap>=1.2')
"""

import json
import struct
import sys
from collections import defaultdict
from pathlib import Path

from matplotlib.figure import Figure
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

folder = Path(sys.argv[1])
picture = Path(sys.argv[2]) if len(sys.argv) > 2 else folder.with_name(f"{folder.name}.png")
samples = defaultdict(list)
parts = sorted(folder.glob("native_*.mcap"), key=lambda part: int(part.stem.rpartition("_")[2]))
for part in parts:
    with part.open("rb") as stream:
        try:
            for _, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                samples[channel.topic].append(json.loads(message.data))
        except (McapError, EOFError, ValueError, struct.error) as error:
            # The recorder was killed: all that it wrote before is drawn.
            print(f"{part} was cut off: {error}", file=sys.stderr)
poses, wheels = samples["yahboomd/pose"], samples["yahboomd/wheels"]
if not poses:
    sys.exit(f"There are no poses in {folder}: name a folder that `yahboomd record` made.")


def seconds(sample: dict) -> float:
    return (sample["stamp_ns"] - poses[0]["stamp_ns"]) * 1e-9


figure = Figure(figsize=(13, 7), layout="constrained")
axes = figure.subplot_mosaic([["path", "wheels"], ["path", "battery"], ["events", "events"]])
axes["path"].set(title="path", xlabel="x, m", ylabel="y, m", aspect="equal")
axes["path"].plot([pose["x"] for pose in poses], [pose["y"] for pose in poses])
axes["path"].plot(poses[-1]["x"], poses[-1]["y"], "s", label="end")
axes["path"].legend()

axes["wheels"].set(title="wheels: dashed is commanded", ylabel="m/s")
for index, name in enumerate(wheels[0]["names"] if wheels else ()):
    times = [seconds(sample) for sample in wheels]
    (line,) = axes["wheels"].plot(times, [each["speed_m_s"][index] for each in wheels], label=name)
    commanded = [each["command_m_s"][index] for each in wheels]
    axes["wheels"].plot(times, commanded, "--", color=line.get_color())
if wheels:
    axes["wheels"].legend()

battery = samples["yahboomd/battery"]
axes["battery"].set(title="battery", ylabel="V")
axes["battery"].plot([seconds(each) for each in battery], [each["volts"] for each in battery])

axes["events"].set(title="events", xlabel="time, s", yticks=[], xlim=(0, seconds(poses[-1])))
for number, event in enumerate(samples["yahboomd/events"]):
    axes["events"].axvline(seconds(event), alpha=0.3)
    axes["events"].text(seconds(event), number % 8 / 8, f" {event['kind']}", fontsize="x-small")
figure.savefig(picture)
print(picture)
