#!/usr/bin/env python3
"""N-mode SVD beside tensor trains: Table 1 of Ballester-Ripoll & Pajarola 2016 on other materials.

For each raw BTF given, or for every material that `weft synth --list` names if none is: N-SVD of five
modes (HOOI, three iterations from HOSVD, ranks the same part of each mode, all channels), a tensor train
at its error (1) and one at its size (2), all stored as half.

    python3 tools/tensor_table.py --results table.json [--weft PROGRAM] [BTF ...]

Every row is kept in the results once it is measured; a run that was stopped goes on from there, and
--times measures the time of a random texel again for all models that were kept. Prints the table as
Markdown. plot_tensor_table.py draws it.
"""
import argparse
import json
import os
import sys
import tempfile

from measure import materials as known_materials, run

KINDS = {"nsvd": "N-SVD", "tt1": "TT (1)", "tt2": "TT (2)"}
MODES = "xycvl"


class Measured:
    """Rows by material and kind, in a file that grows row by row."""

    def __init__(self, path):
        self.path = path
        self.rows = {}
        if path and os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                self.rows = json.load(file)

    def get(self, material, kind):
        return self.rows.get(material, {}).get(kind)

    def put(self, material, kind, row):
        self.rows.setdefault(material, {})[kind] = row
        if self.path:
            with open(self.path + ".part", "w", encoding="utf-8") as file:
                json.dump(self.rows, file, indent=1)
            os.replace(self.path + ".part", self.path)


def codec_options(kind, shape, part, nsvd):
    """The options of one row; the trains follow the N-SVD's."""
    if kind == "tt1":
        return ["--codec", "tt", "--target", f"rel={nsvd['relative']}"]
    if kind == "tt2":
        return ["--codec", "tt", "--target", f"size={nsvd['bytes']}"]
    views, lights, height, width, channels = shape
    sizes = {"x": width, "y": height, "v": views, "l": lights}
    ranks = [f"{mode}={max(1, round(part * size))}" for mode, size in sizes.items()]
    return ["--codec", "tucker", "--method", "hooi", "--start", "hosvd", "--iterations", "3",
            "--ranks", ",".join(ranks + [f"c={channels}"])]


def texel(weft, model):
    """Time in ms, products and sums of one random texel with all channels."""
    report = run(weft, "bench", "--model", model, "--filter", "texel")
    return report["texel_time"], report["texel_operations"]


def measure(weft, source, kind, model, options):
    report = run(weft, "compress", source, "-o", model, *options)
    parameters = report["parameters"]
    ranks = parameters.get("kept") or [parameters["ranks"][mode] for mode in MODES]
    time, operations = texel(weft, model)
    return {"bytes": report["file_size"], "ranks": ranks, "encode_s": report["encode_time"],
            "texel_ms": time, "operations": operations, "relative": report["errors"]["relative"],
            "psnr": report["errors"]["psnr"]}


def print_table(measured):
    print("| | space MiB | ranks | encoding s | texel ms | operations | PSNR dB |")
    print("|---|---|---|---|---|---|---|")
    for material, rows in measured.rows.items():
        for kind in (k for k in KINDS if k in rows):
            row = rows[kind]
            print(f"| {material}, {KINDS[kind]} | {row['bytes'] / 2**20:.2f} "
                  f"| {', '.join(str(r) for r in row['ranks'])} | {row['encode_s']:.1f} "
                  f"| {row['texel_ms']:.4f} | {row['operations']} | {row['psnr']:.2f} |")


def synthesise(options, material, path):
    run(options.weft, "synth", "--material", material, "--size", str(options.size), "--view-set",
        options.views, "--light-set", options.views, "--samples", str(options.samples), "--dtype", "u8",
        "-o", path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("btf", nargs="*", help="raw BTFs; none: every material of `weft synth`")
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--results", help="file of the rows measured so far")
    parser.add_argument("--models", help="folder that keeps the models, MATERIAL-KIND.weft")
    parser.add_argument("--rows", default=",".join(KINDS), help="of nsvd, tt1 and tt2")
    parser.add_argument("--times", action="store_true", help="measure texels of kept models again")
    parser.add_argument("--print", action="store_true", help="print what is measured, and stop")
    parser.add_argument("--size", type=int, default=256, help="texels along a side of materials")
    parser.add_argument("--views", default="ubo81", help="views and lights of materials")
    parser.add_argument("--samples", type=int, default=1, help="rays per texel of materials")
    parser.add_argument("--part", type=float, default=0.37,
                        help="of each mode's size that N-SVD's ranks are; the paper's are 0.27 to 0.43")
    parser.add_argument("--memory", default="4GiB")
    options = parser.parse_args()
    kinds = options.rows.split(",")
    if not set(kinds) <= set(KINDS):
        parser.error(f"--rows {options.rows}: nsvd, tt1 and tt2 are known")
    if options.times and not options.models:
        parser.error("--times: needs the models that --models kept")

    measured = Measured(options.results)
    if options.print:
        return print_table(measured)
    with tempfile.TemporaryDirectory() as folder:
        models = options.models or folder
        os.makedirs(models, exist_ok=True)
        materials = options.btf
        if not materials:
            materials = known_materials(options.weft)
        for source in materials:
            material = os.path.splitext(os.path.basename(source))[0]
            model = {kind: os.path.join(models, f"{material}-{kind}.weft") for kind in KINDS}
            if options.times:
                for kind in (k for k in kinds if measured.get(material, k)):
                    time, operations = texel(options.weft, model[kind])
                    row = measured.get(material, kind)
                    measured.put(material, kind, {**row, "texel_ms": time, "operations": operations})
                continue
            missing = [kind for kind in KINDS if kind in kinds and not measured.get(material, kind)]
            if not missing:
                continue
            made = not options.btf
            if made:
                source = os.path.join(folder, "raw.safetensors")
                synthesise(options, material, source)
            shape = run(options.weft, "info", source)["files"][0]["shape"]
            for kind in missing:
                nsvd = measured.get(material, "nsvd")
                if kind != "nsvd" and nsvd is None:
                    raise RuntimeError(f"{material}: {KINDS[kind]} follows N-SVD, which is not measured")
                row = measure(options.weft, source, kind, model[kind],
                              [*codec_options(kind, shape, options.part, nsvd), "--memory", options.memory])
                measured.put(material, kind, row)
                print(f"{material}, {KINDS[kind]}: {row}", file=sys.stderr, flush=True)
            if made:
                os.remove(source)
    return print_table(measured)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError) as error:
        sys.exit(f"tensor_table.py: error: {error}")
