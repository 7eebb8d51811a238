#!/usr/bin/env python3
"""Multi-level vector quantisation on simulated materials: Tables 2 and 3 of Havran et al. 2010.

    tools/vector_quantisation.py WEFT [--results vq.json] [--size 64] [--samples 16] [--memory 4GiB]
                                 [--materials weave,corduroy,...] [--threshold 0.1] [--options "..."]
                                 [--parts table,shared,lpca,levels] [--table-only] > tables.md

Materials of SIZE x SIZE texels, 81 views and 81 lights, 8 bits. For each: the ratio of the representations 1
to 4 of Table 2, counted from the sizes of the code-books (indices of 32 bits or of as many as they need, reals of
32 or of 8 bits), the file with --storage q=8, its errors, SSIM and time; the code-books in the form of Table 3,
how many vectors one code-vector stands for on each level, of which P4's is that of vector quantisation on one
level alone. Then all materials in one data base (representation 5), `lpca` at the size of the file, and mip
levels. Runs that are in the results are not repeated; each is added as soon as it is done. All times are those that
the program reports.
"""
import argparse
import os
import sys
import tempfile

from measure import Unmet, load, run, save

MATERIALS = "weave,corduroy,knit,leather,gravel,coins,hammered,net"
PARTS = ("table", "shared", "lpca", "levels")
BOOKS = ("P1", "P2", "C", "I1", "I2", "M", "P3", "P4")
DIRECTIONS = 81


def bits_of(count):
    """Of an index into so many."""
    return max((count - 1).bit_length(), 1)


def numbers_of(sizes, slices, texels):
    """Reals, and indices with their bits, of code-books and of planar indices with so many entries."""
    alpha, beta, theta, phi = slices
    reals = (sizes["P1"] * beta + sizes["P2"] * alpha + sizes["P3"] * theta + sizes["P4"] * phi + texels
             + 2 * sizes["C"])
    indices = [(sizes["P2"] * alpha, sizes["P1"]), (sizes["M"], sizes["P2"]), (sizes["M"], sizes["I2"]),
               (sizes["P3"] * theta, sizes["M"]), (sizes["P4"] * phi, sizes["P3"]), (texels, sizes["P4"]),
               (sizes["I1"] * beta, sizes["C"]), (sizes["I2"] * alpha, sizes["I1"])]
    return reals, indices


def representations(sizes, slices, texels):
    """Bytes with indices of 32 bits or of as many as they need, and reals of 32 or of 8 bits."""
    reals, indices = numbers_of(sizes, slices, texels)
    wide = 4 * sum(count for count, _ in indices)
    narrow = sum((count * bits_of(among) + 7) // 8 for count, among in indices)
    return [wide + 4 * reals, narrow + 4 * reals, wide + reals, narrow + reals]


def vectors_of(slices, texels):
    """How many vectors there are on each level, of which the code-books keep some."""
    alpha, beta, theta, phi = slices
    hemispheres = texels * phi * theta
    lights = hemispheres * alpha
    return {"P4": texels, "P3": texels * phi, "M": hemispheres, "P2": hemispheres, "I2": hemispheres, "P1": lights,
            "I1": lights, "C": lights * beta}


class Runs:
    """What is measured, by key, and the raw BTFs, made when they are needed."""

    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.results = load(options.results)
        self.materials = options.materials.split(",")

    def path(self, name):
        return os.path.join(self.folder, name)

    def raw(self, material):
        path = self.path(material + ".safetensors")
        if not os.path.exists(path):
            run(self.options.weft, "synth", "--material", material, "--size", str(self.options.size), "--samples",
                str(self.options.samples), "--view-set", "ubo81", "--light-set", "ubo81", "--dtype", "u8", "-o", path)
        return path

    def compress(self, *arguments):
        return run(self.options.weft, "compress", *arguments, "--memory", self.options.memory)

    def vq(self, *arguments):
        threshold = ["--threshold", self.options.threshold] if self.options.threshold else []
        return self.compress("--codec", "vq", *threshold, *self.options.options.split(), *arguments)

    def key(self, *parts):
        options = self.options
        return "|".join([f"{options.size}, {options.samples}, {options.threshold} {options.options}".strip(), *parts])

    def measure(self, *parts, work):
        name = self.key(*parts)
        if name not in self.results:
            self.results[name] = work()
            save(self.options.results, self.results)
            print(name, self.results[name], file=sys.stderr, flush=True)

    def found(self, *parts):
        return self.results.get(self.key(*parts))


def row_of(report):
    parameters = report["parameters"]
    errors = report["errors"]
    return {"sizes": parameters["sizes"], "slices": parameters["slices"], "raw": report["raw_size"],
            "bytes": report["file_size"], "snr": errors["snr"], "ssim": errors.get("ssim"),
            "seconds": report["encode_time"]}


def shared_row(runs):
    """All materials in one data base, alone with the same storage beside it."""
    report = runs.vq(*[runs.raw(material) for material in runs.materials], "--storage", "q=8", "-o",
                     runs.path("base.weft"))
    return {"sizes": report["parameters"]["sizes"], "slices": report["parameters"]["slices"],
            "raw": report["raw_size"], "bytes": report["file_size"], "shared": report["shared_size"],
            "snr": {row["name"]: row["snr"] for row in report["materials"]}, "seconds": report["encode_time"]}


def lpca_row(runs, material):
    size = runs.found("table", material)["bytes"]
    try:
        report = runs.compress(runs.raw(material), "--codec", "lpca", "--target", f"size={size}", "--ssim",
                               "-o", runs.path("lpca.weft"))
    except Unmet as unmet:
        return {"unmet": str(unmet).removeprefix("weft compress: error: ")}
    return {"bytes": report["file_size"], "snr": report["errors"]["snr"], "ssim": report["errors"].get("ssim"),
            "seconds": report["encode_time"]}


def levels_row(runs, material):
    report = runs.vq(runs.raw(material), "--levels", "all", "--storage", "q=8", "-o", runs.path("levels.weft"))
    return row_of(report)


def measure(runs):
    for material in runs.materials:
        if "table" in runs.options.parts:
            runs.measure("table", material, work=lambda: row_of(
                runs.vq(runs.raw(material), "--storage", "q=8", "--ssim", "-o", runs.path("model.weft"))))
        if "lpca" in runs.options.parts and runs.found("table", material):
            runs.measure("lpca", material, work=lambda: lpca_row(runs, material))
        if "levels" in runs.options.parts:
            runs.measure("levels", material, work=lambda: levels_row(runs, material))
    if "shared" in runs.options.parts and len(runs.materials) > 1:
        runs.measure("shared", runs.options.materials, work=lambda: shared_row(runs))


def print_representations(runs):
    texels = runs.options.size ** 2
    rows = {material: runs.found("table", material) for material in runs.materials}
    rows = {material: row for material, row in rows.items() if row}
    if not rows:
        return
    print("| material | 1 | 2 | 3 | 4 | file, q=8 | bytes | SNR, dB | SSIM | encoding, s |\n" + "|---" * 10 + "|")
    for material, row in rows.items():
        ratios = [f"1:{row['raw'] / size:.1f}" for size in representations(row["sizes"], row["slices"], texels)]
        ssim = "-" if row["ssim"] is None else f"{row['ssim']:.3f}"
        print(f"| {material} | " + " | ".join(ratios) + f" | 1:{row['raw'] / row['bytes']:.1f} | {row['bytes']} "
              f"| {row['snr']:.2f} | {ssim} | {row['seconds']:.1f} |")
    print("\n| vectors to a code-vector | " + " | ".join(BOOKS) + " |\n" + "|---" * (len(BOOKS) + 1) + "|")
    for material, row in rows.items():
        there = vectors_of(row["slices"], texels)
        print(f"| {material} | " + " | ".join(f"1:{there[book] / row['sizes'][book]:.3g}" for book in BOOKS) + " |")


def print_shared(runs):
    row = runs.found("shared", runs.options.materials)
    if not row:
        return
    texels = len(runs.materials) * runs.options.size ** 2
    print(f"\n{len(runs.materials)} materials in one data base: {row['bytes']} bytes, "
          f"1:{row['raw'] / row['bytes']:.1f}, {row['seconds']:.0f} s of encoding.")
    alone = [runs.found("table", material) for material in runs.materials]
    if not all(alone):
        return
    files = sum(one["bytes"] for one in alone)
    counted = sum(representations(one["sizes"], one["slices"], runs.options.size ** 2)[3] for one in alone)
    together = representations(row["sizes"], row["slices"], texels)[3]
    print(f"Alone they take {files} bytes: the ratio grows by {100 * (files / row['bytes'] - 1):.1f} %; counted as "
          f"representations 4 and 5, from 1:{row['raw'] / counted:.1f} to 1:{row['raw'] / together:.1f}, by "
          f"{100 * (counted / together - 1):.1f} %. Their SNR changes by "
          + ", ".join(f"{row['snr'][material] - one['snr']:+.2f} dB ({material})"
                      for material, one in zip(runs.materials, alone)) + ".")


def print_lpca(runs):
    rows = [(material, runs.found("table", material), runs.found("lpca", material)) for material in runs.materials]
    rows = [row for row in rows if row[1] and row[2]]
    if not rows:
        return
    print("\n| material | bytes, vq | SNR, dB | SSIM | bytes, lpca | SNR, dB | SSIM | s, vq | s, lpca |\n"
          + "|---" * 9 + "|")
    for material, own, lpca in rows:
        def cells(row):
            ssim = "-" if row["ssim"] is None else f"{row['ssim']:.3f}"
            return f"{row['bytes']} | {row['snr']:.2f} | {ssim}"
        other = lpca["unmet"] + " | | " if "unmet" in lpca else cells(lpca)
        took = "" if "unmet" in lpca else f"{lpca['seconds']:.1f}"
        print(f"| {material} | {cells(own)} | {other} | {own['seconds']:.1f} | {took} |")


def print_levels(runs):
    rows = [(material, runs.found("table", material), runs.found("levels", material)) for material in runs.materials]
    rows = [row for row in rows if row[1] and row[2]]
    if not rows:
        return
    print("\n| material | bytes | with all mip levels | times | SNR, dB | with them |\n" + "|---" * 6 + "|")
    for material, one, all_levels in rows:
        print(f"| {material} | {one['bytes']} | {all_levels['bytes']} | {all_levels['bytes'] / one['bytes']:.2f} "
              f"| {one['snr']:.2f} | {all_levels['snr']:.2f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weft")
    parser.add_argument("--results", help="JSON file that runs are added to")
    parser.add_argument("--size", type=int, default=64, help="texels along a side")
    parser.add_argument("--samples", type=int, default=16, help="rays per texel; noise takes code-vectors")
    parser.add_argument("--materials", default=MATERIALS)
    parser.add_argument("--threshold", default="0.1", help="none if empty, as with --options '--target snr=15'")
    parser.add_argument("--options", default="", help="more options of weft compress --codec vq")
    parser.add_argument("--parts", default=",".join(PARTS), help="of " + ", ".join(PARTS))
    parser.add_argument("--memory", default="4GiB")
    parser.add_argument("--table-only", action="store_true", help="print what is measured")
    options = parser.parse_args()
    options.parts = options.parts.split(",")
    if not set(options.parts) <= set(PARTS):
        parser.error(f"--parts {','.join(options.parts)}: {', '.join(PARTS)} are known")
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(options, folder)
        if not options.table_only:
            measure(runs)
        print_representations(runs)
        print_shared(runs)
        print_lpca(runs)
        print_levels(runs)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError, ValueError) as error:
        sys.exit(f"vector_quantisation.py: error: {error}")
