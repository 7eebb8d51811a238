#!/usr/bin/env python3
"""What modelling less of a material saves, at equal quality of a rendered picture.

For every material of `weft synth` named, every codec is run at a ladder of parameters, once for all that
there is and once for every variant: options of `weft compress` such as a selection or weights. Each model
is rendered beside the raw material, on the sphere of `weft render` or by the options of --scene, and its file
size and the PSNR of the picture as shown are kept; every run is added to the JSON file as soon as it is done, and runs that are in
it already are not repeated. Printed is Markdown: for each variant, what the picture loses at the least
(raw data of the same selection), where, and the bytes that it saves at equal PSNR.

    python3 tools/scene_selection.py [--weft build/release/tools/weft/weft] [--json scenes.json]
                                     [--materials weave,leather,...] [--codecs pca,tt,...] [--size 64]
                                     [--variant "cone=--views theta<=60 --lights theta<=60"]
                                     [--scene "--shape plane --turn 30,-90 --light 40,20"]
                                     [--pictures FOLDER] [--table-only]
"""
import argparse
import math
import os
import shlex
import sys
import tempfile
import zlib

import numpy as np

from measure import Unmet, load, run, save

LADDERS = {
    "pca": [["--rank", str(rank)] for rank in (8, 16, 32, 64)],
    "lpca": [["--clusters", "16", "--rank", str(rank)] for rank in (2, 4, 8)],
    "view-pca": [["--rank", str(rank)] for rank in (2, 4, 8)],
    "sparse": [["--k1", str(k1), "--k2", str(k2)] for k1, k2 in ((3, 4), (6, 8), (12, 16))],
    "tt": [["--target", f"ratio={ratio}"] for ratio in (400, 200, 100)],
    "tucker": [["--target", f"ratio={ratio}"] for ratio in (400, 200, 100)],
}
SELECTION = ("--views", "--lights", "--region", "--channels", "--level")
RENDERING = ["--size", "200", "--samples", "2"]
EYE = 4.0  # the camera's distance from the middle of the sphere, in radii
FIELD_OF_VIEW = 35.0


def read_png(path):
    """[height][width][3] of an 8-bit RGB picture without interlacing."""
    with open(path, "rb") as file:
        data = file.read()
    position, packed = 8, b""
    while position < len(data):
        length, kind = int.from_bytes(data[position:position + 4], "big"), data[position + 4:position + 8]
        body = data[position + 8:position + 8 + length]
        if kind == b"IHDR":
            width, height = int.from_bytes(body[:4], "big"), int.from_bytes(body[4:8], "big")
            if body[8:] != bytes((8, 2, 0, 0, 0)):
                raise ValueError(f"{path}: not a plain 8-bit RGB picture")
        elif kind == b"IDAT":
            packed += body
        position += 12 + length
    lines = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 3 * width)
    picture = np.zeros((height + 1, width + 1, 3), np.int64)  # row and column 0 are zero
    for y in range(height):
        line = lines[y, 1:].reshape(width, 3).astype(np.int64)
        for x in range(width):
            left, above, corner = picture[y + 1, x], picture[y, x + 1], picture[y, x]
            filter_kind = lines[y, 0]
            if filter_kind == 0:
                guess = 0
            elif filter_kind == 1:
                guess = left
            elif filter_kind == 2:
                guess = above
            elif filter_kind == 3:
                guess = (left + above) // 2
            else:
                a, b, c = np.abs(above - corner), np.abs(left - corner), np.abs(left + above - 2 * corner)
                guess = np.where((a <= b) & (a <= c), left, np.where(b <= c, above, corner))
            picture[y + 1, x + 1] = (line[x] + guess) & 255
    return picture[1:, 1:].astype(float) / 255


def view_angles(height, width):
    """theta of the view at every pixel of the sphere, in degrees; NaN beside it."""
    half = math.tan(math.radians(FIELD_OF_VIEW / 2))
    y, x = np.mgrid[0:height, 0:width]
    across = (2 * (x + 0.5) / width - 1) * half
    down = (2 * (y + 0.5) / height - 1) * half * height / width
    sine = np.sqrt((across**2 + down**2) / (1 + across**2 + down**2))  # of the ray and the axis
    with np.errstate(invalid="ignore"):
        return np.degrees(np.arcsin(EYE * sine))


def selection_of(options):
    """Of options of `weft compress`, those that select."""
    chosen = []
    for option, value in zip(options, options[1:]):
        if option in SELECTION:
            chosen += [option, value]
    return chosen


def measure(options, variants, rows):
    scene = shlex.split(options.scene)
    with tempfile.TemporaryDirectory() as folder:
        raw, model, picture = (os.path.join(folder, name) for name in ("raw.safetensors", "m.weft", "p.png"))
        for material in options.materials.split(","):
            label = f"{material} {options.size}{options.scene and ' ' + options.scene}"
            made = False

            def need_raw():
                nonlocal made
                if not made:
                    run(options.weft, "synth", "--material", material, "--size", str(options.size),
                        "--view-set", "ubo81", "--light-set", "ubo81", "--samples", "1", "--dtype", "f16",
                        "-o", raw)
                made = True

            def add(key, row):
                rows[key] = row
                save(options.json, rows)
                print(f"{key}: {row.get('size', '')} {row.get('psnr', row.get('unmet'))}", file=sys.stderr,
                      flush=True)

            # what a selection alone loses
            for variant, chosen in variants.items():
                key = f"{label}|{variant}|raw|"
                selected = selection_of(chosen)
                if not selected or (key in rows and not options.pictures):
                    continue
                need_raw()
                report = run(options.weft, "render", raw, *selected, "--compare", raw, *scene,
                             *RENDERING, "-o", picture)
                row = {"material": label, "variant": variant, "codec": "raw",
                       "psnr": float(report["errors_as_shown"]["psnr"])}
                if not scene:
                    found, wanted = read_png(picture), read_png(picture[:-4] + "-original.png")
                    squares = ((found - wanted)**2).sum(axis=2)
                    angles = view_angles(*squares.shape)
                    rim = angles > 60
                    row["rim_pixels"] = float(rim.sum() / np.isfinite(angles).sum())
                    row["rim_squares"] = float(squares[rim].sum() / squares.sum())
                add(key, row)
                if options.pictures:
                    target = os.path.join(options.pictures, f"selection-{variant}-{material}.png")
                    run(options.weft, "render", raw, *selected, "--compare", raw, "--size", "160",
                        "--samples", "16", *scene, "-o", target)
            for codec in options.codecs.split(","):
                for variant, chosen in variants.items():
                    for parameters in LADDERS[codec]:
                        key = f"{label}|{variant}|{codec}|{' '.join(parameters)}"
                        if key in rows:
                            continue
                        need_raw()
                        row = {"material": label, "variant": variant, "codec": codec, "options": parameters}
                        try:
                            report = run(options.weft, "compress", raw, "--codec", codec, *parameters, *chosen,
                                         "-o", model)
                            row.update(size=report["file_size"], seconds=report["encode_time"])
                            report = run(options.weft, "render", model, "--compare", raw, *scene, *RENDERING,
                                         "-o", picture)
                            row["psnr"] = float(report["errors_as_shown"]["psnr"])
                        except Unmet as unmet:
                            row["unmet"] = str(unmet)
                        add(key, row)


def curve(rows, material, variant, codec):
    """[(PSNR, bytes), ...], both ascending, without runs that a smaller file beats."""
    points = []
    for size, psnr in sorted((row["size"], row["psnr"]) for row in rows.values()
                             if "size" in row and (row["material"], row["variant"], row["codec"])
                             == (material, variant, codec)):
        if not points or psnr > points[-1][0]:
            points.append((psnr, size))
    return points


def size_at(points, psnr):
    """Bytes at that PSNR, between the points of a curve with logarithmic bytes; None beyond them."""
    for (low, size), (high, next_size) in zip(points, points[1:]):
        if low <= psnr <= high:
            return size * (next_size / size)**((psnr - low) / (high - low))
    return None


def print_tables(rows, variants):
    materials = sorted({row["material"] for row in rows.values()})
    for variant, chosen in variants.items():
        if not chosen:
            continue
        print(f"\n`{' '.join(shlex.quote(part) for part in chosen)}`\n")
        losses = [(material, rows.get(f"{material}|{variant}|raw|")) for material in materials]
        if any(row for _, row in losses):
            print("| material | PSNR of the raw selection | sphere seen beyond 60 degrees | its share of the "
                  "squared error |\n|---|---|---|---|")
            for material, row in losses:
                if row:
                    rim = ("-", "-")
                    if "rim_pixels" in row:
                        rim = (f"{100 * row['rim_pixels']:.0f} % of its pixels", f"{100 * row['rim_squares']:.0f} %")
                    loss = f"{row['psnr']:.1f} dB" if math.isfinite(row["psnr"]) else "nothing is lost"
                    print(f"| {material} | {loss} | {rim[0]} | {rim[1]} |")
            print()
        print("| material | codec | saved at the lowest PSNR of both | at the highest | best PSNR: whole | this |\n"
              "|---|---|---|---|---|---|")
        for material in materials:
            for codec in LADDERS:
                whole, part = (curve(rows, material, name, codec) for name in ("whole", variant))
                if not whole or not part:
                    continue
                low, high = max(whole[0][0], part[0][0]), min(whole[-1][0], part[-1][0])
                cells = []
                for psnr in (low, high):
                    wanted, found = size_at(whole, psnr), size_at(part, psnr)
                    if low > high or wanted is None or found is None:
                        cells.append("-")
                    else:
                        cells.append(f"{100 * (1 - found / wanted):.0f} % at {psnr:.1f} dB "
                                     f"({wanted / 2**10:.0f} to {found / 2**10:.0f} KiB)")
                print(f"| {material} | `{codec}` | " + " | ".join(cells)
                      + f" | {whole[-1][0]:.1f} dB | {part[-1][0]:.1f} dB |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--json", default="scenes.json", help="runs that are done")
    parser.add_argument("--materials", default="weave,leather,hammered", help="of `weft synth --list`")
    parser.add_argument("--codecs", default="pca,lpca,tt")
    parser.add_argument("--size", type=int, default=64, help="texels along a side")
    parser.add_argument("--variant", action="append", metavar="NAME=OPTIONS",
                        help="options of weft compress to compare with none; several may be given")
    parser.add_argument("--scene", default="", metavar="OPTIONS",
                        help="options of weft render; without, its sphere and its light")
    parser.add_argument("--pictures", metavar="FOLDER", help="also draw what selections alone lose")
    parser.add_argument("--table-only", action="store_true", help="of what the JSON file has")
    options = parser.parse_args()
    unknown = [codec for codec in options.codecs.split(",") if codec not in LADDERS]
    if unknown:
        parser.error(f"--codecs {','.join(unknown)}: only {', '.join(LADDERS)} are known")
    variants = {"whole": []}
    for text in options.variant or ["cone=--views theta<=60 --lights theta<=60"]:
        name, equals, arguments = text.partition("=")
        if not equals or not name or name == "whole":
            parser.error(f"--variant {text}: not NAME=OPTIONS")
        variants[name] = shlex.split(arguments)
    rows = load(options.json)
    if not options.table_only:
        measure(options, variants, rows)
    print_tables(rows, variants)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError, ValueError) as error:
        sys.exit(f"scene_selection.py: error: {error}")
