#!/usr/bin/env python3
"""Goals of every codec on simulated materials: what was reached, what the search took.

    tools/goals.py WEFT [--results goals.json] [--materials leather,weave] [--codecs pca,kcta]
                        [--size 64] [--directions 41] > table.md

For each codec and material it asks --target snr=15, snr=20 and ratio=100. Beside the time of the search stands
that of its last decomposition, about a single encode. Runs that are in the results are not repeated; each is
added as soon as it is done. All times are those that the program reports.
"""
import argparse
import os
import sys
import tempfile

from measure import Unmet, load, run, save

GOALS = ["snr=15", "snr=20", "ratio=100"]
CODECS = ["pca", "view-pca", "lpca", "sparse", "tucker", "tt", "cta", "kcta"]
MATERIALS = "leather,corduroy,hammered,gravel,net,coins,weave"


def meet(weft, source, codec, goal, folder):
    try:
        report = run(weft, "compress", source, "-o", os.path.join(folder, "model.weft"), "--codec", codec,
                     "--target", goal)
    except Unmet as unmet:
        return {"unmet": str(unmet)}
    met = report["goal"]
    return {"reached": met["reached"], "snr": report["errors"]["snr"], "bytes": report["file_size"],
            "decompositions": met["decompositions"], "trials": met["trials"],
            "search": met["search_time"], "last": met["decomposition_time"]}


def row(material, codec, goal, found):
    if "unmet" in found:
        return f"| {material} | {codec} | {goal} | {found['unmet']} | | | | | | |"
    ratio = f"{found['search'] / found['last']:.2f}" if found["last"] > 0 else ""
    return (f"| {material} | {codec} | {goal} | {found['reached']:.4g} | {found['snr']:.2f} | {found['bytes']} "
            f"| {found['decompositions']} | {found['trials']} | {found['search']:.2f} | {ratio} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("weft")
    parser.add_argument("--results", help="JSON file that runs are added to")
    parser.add_argument("--materials", default=MATERIALS)
    parser.add_argument("--codecs", default=",".join(CODECS))
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--directions", type=int, default=41)
    options = parser.parse_args()
    results = load(options.results)
    print("| material | codec | goal | reached | SNR, dB | file, bytes | decompositions | models measured "
          "| search, s | search / last decomposition |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for material in options.materials.split(","):
            source = None
            for codec in options.codecs.split(","):
                for goal in GOALS:
                    key = f"{material} {options.size} {options.directions} {codec} {goal}"
                    if key not in results:
                        if source is None:
                            source = os.path.join(folder, material + ".safetensors")
                            run(options.weft, "synth", "--material", material, "--size",
                                f"{options.size}x{options.size}", "--view-set", str(options.directions),
                                "--light-set", str(options.directions), "-o", source)
                        results[key] = meet(options.weft, source, codec, goal, folder)
                        save(options.results, results)
                    print(row(material, codec, goal, results[key]), flush=True)
            if source is not None:
                os.remove(source)


if __name__ == "__main__":
    try:
        main()
    except (RuntimeError, OSError, ValueError) as error:
        sys.exit(f"goals.py: {error}")
