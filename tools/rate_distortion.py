#!/usr/bin/env python3
"""Size against RMSE of the codecs, as Fig. 3 of Ruiters & Klein 2009.

For every raw BTF given, or for every material that `weft synth --list` names if none is, every codec is
run at a grid of parameters. Each run is added to the JSON file as soon as it is done, and runs that are
in it already are not repeated. From the file come a table (Markdown, on standard output), the size of
each codec at the RMSE of the sparse tensors in relation to theirs, and an SVG with a plot per BTF.

    python3 tools/rate_distortion.py [--weft build/release/tools/weft/weft] [--json rates.json]
                                     [--svg rates.svg] [--size 128] [--dtype f16] [--only NAME,...]
                                     [--codecs sparse,pca,...] [--plot-only] [BTF ...]
"""
import argparse
import math
import os
import sys
import tempfile

from measure import Unmet, load, materials, run, save

RATIOS = (1600, 800, 400, 200, 100)
GRID = {
    # fewer atoms where files are small: dictionaries and the lists of views don't shrink with the texels
    "sparse": [["--target", f"ratio={ratio}"] for ratio in RATIOS]
              + [["--atoms", "64", "--target", f"ratio={ratio}"] for ratio in RATIOS[:3]],
    "pca": [["--rank", str(rank)] for rank in (2, 4, 8, 16, 32, 64)],
    "lpca": [["--clusters", "16", "--rank", str(rank)] for rank in (1, 2, 4, 8)],
    "view-pca": [["--rank", str(rank)] for rank in (1, 2, 4, 8)],
    "tucker": [["--target", f"ratio={ratio}"] for ratio in RATIOS],
}
COLOURS = {"sparse": "#c0392b", "pca": "#2c3e50", "lpca": "#2980b9", "view-pca": "#27ae60",
           "tucker": "#8e44ad"}


def measure(options, rows):
    names = options.btf
    if not names:
        names = materials(options.weft)
        if options.only:
            names = [name for name in names if name in options.only.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            label = name if not options.btf else os.path.splitext(os.path.basename(name))[0]
            if not options.btf:
                label += f" {options.size} {options.dtype}"
            source = name if options.btf else None
            for codec in options.codecs.split(","):
                for arguments in GRID[codec]:
                    key = f"{label}|{codec}|{' '.join(arguments)}"
                    if key in rows:
                        continue
                    if source is None:
                        source = os.path.join(folder, "raw.safetensors")
                        run(options.weft, "synth", "--material", name, "--size", str(options.size),
                            "--samples", str(options.samples), "--dtype", options.dtype, "-o", source)
                    row = {"btf": label, "codec": codec, "options": arguments}
                    try:
                        report = run(options.weft, "compress", source, "--codec", codec, *arguments,
                                     "--memory", options.memory, "-o", os.path.join(folder, "model.weft"))
                        row.update(size=report["file_size"], seconds=report["encode_time"],
                                   **{field: report["errors"][field] for field in ("rmse", "relative", "psnr")})
                    except Unmet as unmet:
                        row["unmet"] = str(unmet)
                    rows[key] = row
                    save(options.json, rows)
                    print(f"{key}: {row.get('size', row.get('unmet'))} {row.get('rmse', '')}",
                          file=sys.stderr, flush=True)


def curves(rows):
    """{btf: {codec: [(bytes, rmse), ...] by size}}, without runs that a smaller file beats."""
    found = {}
    for row in rows.values():
        if "size" in row and row["rmse"] > 0:
            found.setdefault(row["btf"], {}).setdefault(row["codec"], []).append((row["size"], row["rmse"]))
    for codecs in found.values():
        for codec, points in codecs.items():
            best = []
            for size, rmse in sorted(points):
                if not best or rmse < best[-1][1]:
                    best.append((size, rmse))
            codecs[codec] = best
    return found


def size_at(points, rmse):
    """Bytes at which the curve has that RMSE, between its points on logarithmic axes; None beyond them."""
    for (size, error), (next_size, next_error) in zip(points, points[1:]):
        if next_error <= rmse <= error and next_error < error:
            part = math.log(error / rmse) / math.log(error / next_error)
            return math.exp(math.log(size) + part * math.log(next_size / size))
    return None


def print_tables(found):
    print("| BTF | codec | MiB: RMSE |\n|---|---|---|")
    for btf, codecs in sorted(found.items()):
        for codec in GRID:
            if codec in codecs:
                points = ", ".join(f"{size / 2**20:.2f}: {rmse:.4f}" for size, rmse in codecs[codec])
                print(f"| {btf} | `{codec}` | {points} |")
    print("\nBytes of the other codecs by those of `sparse` at equal RMSE, least to largest:\n")
    print("| BTF |" + "".join(f" `{codec}` |" for codec in GRID if codec != "sparse"))
    print("|---" * len(GRID) + "|")
    for btf, codecs in sorted(found.items()):
        cells = []
        for codec in GRID:
            if codec == "sparse":
                continue
            ratios = [other / size for size, rmse in codecs.get("sparse", ())
                      if (other := size_at(codecs.get(codec, ()), rmse))]
            cells.append(f"{min(ratios):.2f} to {max(ratios):.2f}" if ratios else "-")
        print(f"| {btf} | " + " | ".join(cells) + " |")


def plot(found, path):
    """A plot per BTF, three in a row: MiB on a logarithmic axis, RMSE from zero."""
    width, height, left, bottom = 300, 220, 52, 40
    names = sorted(found)
    across = min(3, max(1, len(names)))
    down = (len(names) + across - 1) // across
    svg = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{across * width}" height="{down * height + 30}" '
           'font-family="sans-serif" font-size="11"><rect width="100%" height="100%" fill="white"/>']
    for i, codec in enumerate(GRID):
        svg.append(f'<text x="{left + i * 90}" y="18" fill="{COLOURS[codec]}">\u25cf {codec}</text>')
    for i, btf in enumerate(names):
        points = [point for codec in found[btf].values() for point in codec]
        low, high = min(p[0] for p in points), max(p[0] for p in points)
        high = max(high, low * 1.01)
        top = max(p[1] for p in points) * 1.05
        x0, y0 = i % across * width + left, i // across * height + 30 + height - bottom
        w, h = width - left - 14, height - bottom - 26

        def place(size, rmse):
            return (x0 + w * math.log(size / low) / math.log(high / low), y0 - h * rmse / top)

        svg.append(f'<text x="{x0}" y="{y0 - h - 8}" font-weight="bold">{btf}</text>')
        svg.append(f'<path d="M{x0},{y0 - h}V{y0}H{x0 + w}" fill="none" stroke="#888"/>')
        for step in range(1, 4):
            y = y0 - h * step / 3
            svg.append(f'<path d="M{x0},{y:.1f}H{x0 + w}" stroke="#ddd"/>'
                       f'<text x="{x0 - 4}" y="{y + 4:.1f}" text-anchor="end">{top * step / 3:.3g}</text>')
        for power in range(-8, 12):
            size = 2.0 ** power * 2 ** 20
            if low <= size <= high and (power % 2 == 0 or high / low < 64):
                x, _ = place(size, 0)
                text = f"{2.0 ** power:g}" if power >= -3 else f"1/{2 ** -power}"
                svg.append(f'<path d="M{x:.1f},{y0}v4" stroke="#888"/>'
                           f'<text x="{x:.1f}" y="{y0 + 16}" text-anchor="middle">{text}</text>')
        svg.append(f'<text x="{x0 + w}" y="{y0 + 30}" text-anchor="end">MiB</text>'
                   f'<text x="{x0 - 40}" y="{y0 - h - 8}">RMSE</text>')
        for codec, line in found[btf].items():
            spots = [place(size, rmse) for size, rmse in line]
            path_text = " ".join(f"{x:.1f},{y:.1f}" for x, y in spots)
            svg.append(f'<polyline points="{path_text}" fill="none" stroke="{COLOURS[codec]}" stroke-width="1.6"/>')
            svg += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" fill="{COLOURS[codec]}"/>' for x, y in spots]
    svg.append("</svg>")
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(svg) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("btf", nargs="*", help="raw BTFs; none: every material of `weft synth`")
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--json", default="rates.json", help="runs that are done")
    parser.add_argument("--svg", help="plots to write")
    parser.add_argument("--size", type=int, default=128, help="texels along a side of materials")
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--dtype", default="f16", help="of materials")
    parser.add_argument("--memory", default="4GiB")
    parser.add_argument("--only", help="of the materials, these")
    parser.add_argument("--codecs", default=",".join(GRID))
    parser.add_argument("--plot-only", action="store_true", help="of what the JSON file has")
    options = parser.parse_args()
    unknown = [codec for codec in options.codecs.split(",") if codec not in GRID]
    if unknown:
        parser.error(f"--codecs {','.join(unknown)}: only {', '.join(GRID)} are known")

    rows = load(options.json)
    if not options.plot_only:
        measure(options, rows)
    found = curves(rows)
    print_tables(found)
    if options.svg and found:
        plot(found, options.svg)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError, ValueError) as error:
        sys.exit(f"rate_distortion.py: error: {error}")
