"""What other programs take for scenes of `oblate chart`, and what they draw. See README.md."""

import argparse
import json
import os
import pathlib
import platform

import head
import timing
import warp


def machine():
    """The processor and how many threads it runs."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(": ", 1)[1] for line in lines if line.startswith("model name"))
    except (OSError, StopIteration, IndexError):
        name = platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} threads"


def at_least_seven(text):
    count = int(text)
    if count < 7:
        raise argparse.ArgumentTypeError(f"{count} frames are too few for a median and a spread; 7 or more")
    return count


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("inputs", type=pathlib.Path, help="what the example chart_inputs wrote")
    parser.add_argument("output", type=pathlib.Path, help="the folder for peers.json and the pictures")
    parser.add_argument("--frames", type=at_least_seven, default=9, help="timed ones [default: 9]")
    args = parser.parse_args()
    scenes = json.loads((args.inputs / "scenes.json").read_text())
    if scenes["format"] != 1:
        parser.error(f"{args.inputs / 'scenes.json'}: its format is {scenes['format']}; 1 is read")
    args.output.mkdir(parents=True, exist_ok=True)
    listed = []
    for scene, module in [("head", head), ("warp", warp)]:
        for peer in module.peers(scenes[scene], args.inputs):
            listed.append(timing.measured(peer, args.frames, args.output))
            low, high = listed[-1]["spread_ms"]
            print(f"{scene}, {peer.name}: {listed[-1]['median_ms']:.1f} ms ({low:.1f} to {high:.1f})", flush=True)
    text = json.dumps({"format": 1, "machine": machine(), "peers": listed}, indent=2, ensure_ascii=False)
    (args.output / "peers.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
