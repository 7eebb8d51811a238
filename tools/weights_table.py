#!/usr/bin/env python3
"""What `--weights cos` changes at equal size: errors of the data and of pictures.

Every codec fits every material twice with the same parameters, so that the files are of one size, without
weights and with `--weights cos`. Kept are the SNR of the data, plain and weighted, and the PSNR of a
sphere that `weft render` shows beside the raw material. Every run is added to the JSON file as soon as it is
done, and runs that are in it already are not repeated. Printed is a Markdown table.

    python3 tools/weights_table.py [--weft build/release/tools/weft/weft] [--json weights.json]
                                   [--materials weave,leather,...] [--codecs pca,tt,...] [--size 64]
                                   [--directions 41] [--table-only]
"""
import argparse
import os
import sys
import tempfile

from measure import load, run, save

PARAMETERS = {
    "pca": ["--rank", "16"],
    "view-pca": ["--rank", "4"],
    "lpca": ["--clusters", "16", "--rank", "4"],
    "sparse": ["--k1", "5", "--k2", "8"],
    "tt": ["--ranks", "40,120,40,12"],
    "tucker": ["--ranks", "v=20,l=16,y=40,x=40"],
}


def measure(options, rows):
    weft = options.weft
    with tempfile.TemporaryDirectory() as folder:
        raw, model, picture = (os.path.join(folder, name) for name in ("raw.safetensors", "m.weft", "p.png"))
        for material in options.materials.split(","):
            made = False
            for codec in options.codecs.split(","):
                key = f"{material}|{codec}|{' '.join(PARAMETERS[codec])}"
                if key in rows:
                    continue
                if not made:
                    run(weft, "synth", "--material", material, "--size", str(options.size), "--view-set",
                        str(options.directions), "--light-set", str(options.directions), "--samples", "1",
                        "--dtype", "f16", "-o", raw)
                    made = True
                row = {}
                for weights in ("none", "cos"):
                    chosen = ["--weights", "cos"] if weights == "cos" else []
                    fit = run(weft, "compress", raw, "--codec", codec, *PARAMETERS[codec], *chosen, "-o", model)
                    shown = run(weft, "render", model, "--compare", raw, "--shape", "sphere", "--size", "256",
                                "--samples", "4", "-o", picture)
                    checked = run(weft, "verify", model, "--against", raw, "--weights", "cos")
                    row[weights] = {"size": fit["file_size"], "plain": fit["errors"]["snr"],
                                    "weighted": checked["weighted_errors"][0]["snr"],
                                    "picture": shown["errors_as_shown"]["psnr"]}
                rows[key] = row
                save(options.json, rows)
                print(key, row, file=sys.stderr, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--json", default="weights.json")
    parser.add_argument("--materials", default="weave,leather,hammered")
    parser.add_argument("--codecs", default=",".join(PARAMETERS))
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--directions", type=int, default=41)
    parser.add_argument("--table-only", action="store_true")
    options = parser.parse_args()
    rows = load(options.json)
    if not options.table_only:
        measure(options, rows)
    print("| material | codec | bytes | SNR, dB | with cos | weighted SNR, dB | with cos | sphere, PSNR dB "
          "| with cos |")
    print("|---|---|---|---|---|---|---|---|---|")
    for key, row in rows.items():
        material, codec, _ = key.split("|")
        cells = [f"{row[weights][figure]:.2f}" for figure in ("plain", "weighted", "picture")
                 for weights in ("none", "cos")]
        print(f"| {material} | `{codec}` | {row['none']['size']} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
