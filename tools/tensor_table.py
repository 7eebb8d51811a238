#!/usr/bin/env python3
"""N-mode SVD beside tensor trains, as in Table 1 of Ballester-Ripoll & Pajarola 2016.

For every raw BTF given, or for every material that `weft synth --list` names if none is: N-SVD of five
modes (HOOI, three iterations, ranks a part of each mode, all channels), a tensor train at its error (1)
and one at its size (2). Runs only `weft`; everything is written into a temporary folder.

    python3 tools/tensor_table.py [--weft build/release/tools/weft/weft] [--size 64] [--part 0.37]
                                  [--views ubo81] [--dtype u8] [BTF ...]
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile


def run(weft, *arguments):
    result = subprocess.run([weft, *arguments, "--json", "--quiet"], capture_output=True, text=True)
    if result.returncode != 0:
        raise RuntimeError(f"weft {' '.join(arguments)}: {result.stderr.strip()}")
    return json.loads(result.stdout)


def nsvd_operations(ranks):
    """Sums and products of one texel with all channels: the largest rank is contracted first."""
    rest = sorted((r for mode, r in ranks.items() if mode != "c"), reverse=True)
    count = 0
    for i, rank in enumerate(rest):
        others = ranks["c"]
        for other in rest[i + 1:]:
            others *= other
        count += others * (2 * rank - 1)
    return count + ranks["c"] * (2 * ranks["c"] - 1)


def row(weft, folder, name, source, options):
    model = os.path.join(folder, "model.weft")
    report = run(weft, "compress", source, "-o", model, *options)
    speed = run(weft, "bench", "--model", model, "--lookups", "10000")
    kept = report["parameters"]
    if "kept" in kept:
        ranks = ", ".join(str(r) for r in kept["kept"])
        operations = kept["texel_operations"]
    else:
        ranks = ", ".join(str(kept["ranks"][mode]) for mode in "xycvl")
        operations = nsvd_operations(kept["ranks"])
    size = report["file_size"]
    errors = report["errors"]
    print(f"| {name} | {size / 2**20:.2f} | {ranks} | {report['encode_time']:.1f} "
          f"| {speed['texel_time'] * 1e3:.1f} | {operations} | {errors['psnr']:.2f} |", flush=True)
    return size, errors["relative"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("btf", nargs="*", help="raw BTFs; none: every material of `weft synth`")
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--size", type=int, default=256, help="texels along a side of materials")
    parser.add_argument("--views", default="ubo81", help="views and lights of materials")
    parser.add_argument("--dtype", default="u8")
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--part", type=float, default=0.37, help="of each mode's size that N-SVD's ranks are")
    parser.add_argument("--memory", default="4GiB")
    options = parser.parse_args()

    print("| | MiB | ranks x, y, c, v, l or R1 to R4 | encode s | texel us | operations | PSNR dB |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        names = options.btf
        if not names:
            listed = subprocess.run([options.weft, "synth", "--list"], capture_output=True, text=True, check=True)
            names = [line.split()[0] for line in listed.stdout.splitlines() if line.strip()]
        for name in names:
            source = name
            if not options.btf:
                source = os.path.join(folder, "raw.safetensors")
                run(options.weft, "synth", "--material", name, "--size", str(options.size), "--view-set",
                    options.views, "--light-set", options.views, "--samples", str(options.samples),
                    "--dtype", options.dtype, "-o", source)
            views, lights, height, width, channels = run(options.weft, "info", source)["files"][0]["shape"]
            part = {mode: max(1, round(options.part * size))
                    for mode, size in zip("xyvl", (width, height, views, lights))}
            ranks = ",".join(f"{mode}={rank}" for mode, rank in part.items()) + f",c={channels}"
            common = ["--memory", options.memory]
            label = os.path.splitext(os.path.basename(name))[0]
            size, error = row(options.weft, folder, f"{label}, N-SVD", source,
                              ["--codec", "tucker", "--method", "hooi", "--start", "hosvd", "--iterations",
                               "3", "--ranks", ranks, *common])
            row(options.weft, folder, f"{label}, TT (1)", source,
                ["--codec", "tt", "--target", f"rel={error}", *common])
            row(options.weft, folder, f"{label}, TT (2)", source,
                ["--codec", "tt", "--target", f"size={size}", *common])
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError, subprocess.CalledProcessError) as error:
        sys.exit(f"tensor_table.py: error: {error}")
