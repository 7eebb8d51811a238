#!/usr/bin/env python3
"""Colour transforms at equal file size: errors of every codec under every one of them.

Materials are synthesised, compressed with the same parameters (and so in files of the same size), and
rendered on a ball beside the raw BTF. The table is printed as Markdown.

    python3 tools/transform_table.py [--weft build/release/tools/weft/weft] [--json transforms.json]
                                     [--size 64] [--directions 24] [--table-only]
"""
import argparse
import json
import os
import sys
import tempfile

from measure import run

MATERIALS = [("weave", "u8"), ("hammered", "f32"), ("coins", "f32")]
CODECS = {
    "pca": ["--rank", "12"],
    "view-pca": ["--rank", "4"],
    "lpca": ["--clusters", "8", "--rank", "4"],
    "tucker": ["--ranks", "v=10,l=10,y=32,x=32"],
    "tt": ["--ranks", "24,36,36,16"],
    "sparse": ["--k1", "4", "--k2", "6", "--atoms", "128", "--rank", "64", "--iterations", "10"],
}
TRANSFORMS = {"u8": ["none", "log", "ycrcb", "decorrelated"],
              "f32": ["none", "log", "logluv", "logluv 1,4,4", "decorrelated"]}


def measure(options, rows, folder):
    for material, dtype in MATERIALS:
        raw = os.path.join(folder, f"{material}.safetensors")
        for codec, parameters in CODECS.items():
            for name in TRANSFORMS[dtype]:
                key = f"{material} {dtype}|{codec}|{name}"
                if key in rows:
                    continue
                if not os.path.exists(raw):
                    run(options.weft, "synth", "--material", material, "--size", str(options.size),
                        "--view-set", str(options.directions), "--light-set", str(options.directions),
                        "--samples", "1", "--dtype", dtype, "-o", raw)
                transform, _, weights = name.partition(" ")
                model = os.path.join(folder, "model.weft")
                made = run(options.weft, "compress", raw, "--codec", codec, *parameters, "--transform",
                           transform, *(["--channel-weights", weights] if weights else []), "--log-error",
                           "--ssim", "-o", model)
                ball = run(options.weft, "render", model, "--compare", raw, "--size", "192", "-o",
                           os.path.join(folder, "ball.png"))
                rows[key] = {"bytes": made["file_size"], "rmse": made["errors"]["rmse"],
                             "log_rmse": made["errors"]["log_rmse"], "ssim": made["errors"]["ssim"],
                             "psnr_rendered": ball["errors_as_shown"]["psnr"]}
                print(key, rows[key], file=sys.stderr)
                with open(options.json, "w", encoding="utf-8") as file:
                    json.dump(rows, file, indent=1)
        if os.path.exists(raw):
            os.remove(raw)


def table(rows):
    for material, dtype in MATERIALS:
        print(f"\n**{material}, {dtype}**\n")
        print("| codec | transform | KiB | RMSE | log RMSE | SSIM | rendered PSNR |")
        print("|---|---|---|---|---|---|---|")
        for codec in CODECS:
            found = {name: rows.get(f"{material} {dtype}|{codec}|{name}") for name in TRANSFORMS[dtype]}
            found = {name: row for name, row in found.items() if row}
            best = {column: choice(row[column] for row in found.values())
                    for column, choice in (("rmse", min), ("log_rmse", min), ("ssim", max),
                                           ("psnr_rendered", max))} if found else {}

            def cell(row, column, text):
                return f"**{text}**" if row[column] == best[column] else text

            for name, row in found.items():
                print(f"| {codec} | {name} | {row['bytes'] / 1024:.0f} "
                      f"| {cell(row, 'rmse', format(row['rmse'], '.4g'))} "
                      f"| {cell(row, 'log_rmse', format(row['log_rmse'], '.4g'))} "
                      f"| {cell(row, 'ssim', format(row['ssim'], '.4f'))} "
                      f"| {cell(row, 'psnr_rendered', format(row['psnr_rendered'], '.1f'))} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--json", default="transforms.json")
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--directions", type=int, default=24)
    parser.add_argument("--table-only", action="store_true", help="only print the table of the JSON file")
    options = parser.parse_args()
    rows = {}
    if os.path.exists(options.json):
        with open(options.json, encoding="utf-8") as file:
            rows = json.load(file)
    if not options.table_only:
        with tempfile.TemporaryDirectory() as folder:
            measure(options, rows, folder)
    table(rows)


if __name__ == "__main__":
    main()
