#!/usr/bin/env python3
"""Goals of every codec on simulated materials: what was reached, what the search took.

    tools/goals.py WEFT [--materials leather,weave] [--size 64] [--directions 41] > docs/goals.md

For each codec and material it asks --target snr=15, snr=20 and ratio=100, and then encodes once
more with the parameters that were found where the codec takes them (pca and lpca by their rank,
tucker and tt by their ranks; view-pca by the mean of its views' ranks, sparse by the lengths of its
lists), for the time of a single encode. All times are those that the program reports.
"""
import argparse
import json
import math
import os
import subprocess
import sys
import tempfile

GOALS = ["snr=15", "snr=20", "ratio=100"]
CODECS = ["pca", "view-pca", "lpca", "sparse", "tucker", "tt"]
MATERIALS = "leather,corduroy,hammered,gravel,net,coins,weave"


def run(arguments):
    return subprocess.run(arguments, capture_output=True, text=True, check=False)


def compress(weft, source, model, options):
    result = run([weft, "compress", source, "-o", model, "--json", *options])
    if result.returncode == 0:
        return json.loads(result.stdout), ""
    if result.returncode != 1:
        sys.exit(f"{' '.join(options)}: {result.stderr.strip()}")
    return None, result.stderr.strip().splitlines()[-1]


def single(codec, report):
    """The options of an encode without a goal that gives a model like this one."""
    found = report["parameters"]
    if codec == "pca":
        return ["--rank", str(max(found["kept"], 1))]
    if codec == "view-pca":
        return ["--rank", str(max(round(sum(found["kept"]) / 2), 1))]
    if codec == "lpca":
        return ["--clusters", str(found["clusters"]), "--rank", str(max(found["kept_rank"], 1))]
    if codec == "sparse":
        return ["--k1", str(found["k1"]), "--k2", str(found["k2"]), "--rank", str(found["rank"])]
    if codec == "tucker":
        ranks = found["ranks"]
        return ["--ranks", ",".join(f"{mode}={rank}" for mode, rank in ranks.items())]
    kept = found["kept"]
    return ["--ranks", ",".join(str(rank) for rank in kept)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("weft")
    parser.add_argument("--materials", default=MATERIALS)
    parser.add_argument("--codecs", default=",".join(CODECS))
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--directions", type=int, default=41)
    options = parser.parse_args()
    print(f"| material | codec | goal | reached | file, bytes | decompositions | trials | search, s "
          f"| single encode, s | search / single |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    ratios = {}
    with tempfile.TemporaryDirectory() as folder:
        for material in options.materials.split(","):
            source = os.path.join(folder, "raw.safetensors")
            made = run([options.weft, "synth", "--material", material, "--size",
                        f"{options.size}x{options.size}", "--view-set", str(options.directions),
                        "--light-set", str(options.directions), "--quiet", "-o", source])
            if made.returncode != 0:
                sys.exit(f"{material}: {made.stderr.strip()}")
            for codec in options.codecs.split(","):
                for goal in GOALS:
                    model = os.path.join(folder, "model.weft")
                    report, why = compress(options.weft, source, model,
                                           ["--codec", codec, "--target", goal])
                    if report is None:
                        print(f"| {material} | {codec} | {goal} | {why} | | | | | | |", flush=True)
                        continue
                    plain, _ = compress(options.weft, source, model,
                                        ["--codec", codec, *single(codec, report)])
                    met = report["goal"]
                    ratio = met["search_time"] / plain["encode_time"]
                    ratios.setdefault(codec, []).append(ratio)
                    print(f"| {material} | {codec} | {goal} | {met['reached']:.4g} "
                          f"| {report['file_size']} | {met['decompositions']} | {met['trials']} "
                          f"| {met['search_time']:.2f} | {plain['encode_time']:.2f} "
                          f"| {ratio:.2f} |", flush=True)
            os.remove(source)
    print("\n| codec | search / single encode, geometric mean | goals met |\n|---|---|---|")
    for codec, found in ratios.items():
        mean = math.exp(sum(math.log(ratio) for ratio in found) / len(found))
        print(f"| {codec} | {mean:.2f} | {len(found)} |")


if __name__ == "__main__":
    main()
