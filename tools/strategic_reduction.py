#!/usr/bin/python3
"""TensorTextures cut in one mode beside PCA: Fig. 8 of Vasilescu & Terzopoulos 2004 on other materials.

For each raw BTF given, or for materials of `weft synth` in the paper's setting (37 views x 21 lights): PCA
with 111 eigentextures, as the singular vectors of all images in one mode (`--merge vl,yxc`), and
TensorTextures (`--merge yxc`, views and lights improved by alternating least squares) with as many basis
textures, 37 x 3, with 31 x 4, and cut in the views instead, 5 x 21. Errors are means over all images.

    /usr/bin/python3 tools/strategic_reduction.py [--weft PROGRAM] [--picture knit.png] [BTF ...]

The picture, of the first material, shows one image of each model under a slanting light; it needs
Matplotlib (Debian: python3-matplotlib).
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile

PCA_RANK = 111
BASES = ((37, 3), (31, 4), (5, 21))


def run(weft, *arguments):
    result = subprocess.run([weft, *arguments, "--json", "--quiet"], capture_output=True, text=True)
    if result.returncode != 0:
        raise RuntimeError(f"weft {' '.join(arguments)}: {result.stderr.strip()}")
    return json.loads(result.stdout)


def models_of(shape):
    """(label, basis textures, options of compress), as far as there are directions for them."""
    views, lights = shape[:2]
    yield (f"PCA, {PCA_RANK}", PCA_RANK,
           ["--codec", "tucker", "--merge", "vl,yxc", "--ranks", f"vl={PCA_RANK}"])
    for view_rank, light_rank in BASES:
        if view_rank > views or light_rank > lights:
            continue
        yield (f"TensorTextures, {view_rank} x {light_rank}", view_rank * light_rank,
               ["--codec", "tucker", "--merge", "yxc", "--ranks", f"v={view_rank},l={light_rank}",
                "--method", "hooi", "--start", "hosvd", "--iterations", "20"])


def image_of(weft, file, options, folder):
    """One image of a raw BTF or a model, as a display shows it."""
    import matplotlib.image

    path = os.path.join(folder, "image.png")
    run(weft, "sheet", file, "--views", str(options.view), "--lights", str(options.light), "--exposure",
        str(options.exposure), "-o", path)
    return matplotlib.image.imread(path)


def draw(path, images):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 10})
    figure, axes = plt.subplots(1, len(images), figsize=(2.6 * len(images), 2.9))
    for axis, (label, pixels) in zip(axes, images):
        axis.imshow(pixels, interpolation="nearest")
        axis.set_title(label, fontsize=10)
        axis.set_axis_off()
    figure.tight_layout(pad=0.4, w_pad=0.3)
    figure.savefig(path, dpi=110, bbox_inches="tight", pad_inches=0.05)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("btf", nargs="*", help="raw BTFs; none: materials of `weft synth`")
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--materials", default="knit,weave,coins", help="to synthesise")
    parser.add_argument("--size", type=int, default=128, help="texels along a side of materials")
    parser.add_argument("--samples", type=int, default=4, help="rays per texel of materials")
    parser.add_argument("--picture", help="PNG to draw of the first material")
    parser.add_argument("--view", type=int, default=30, help="of the picture")
    parser.add_argument("--light", type=int, default=16, help="of the picture")
    parser.add_argument("--exposure", type=float, default=2.5, help="of the picture")
    options = parser.parse_args()

    print("| | basis textures | MiB | RMSE | SSIM |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        model = os.path.join(folder, "model.weft")
        raw = os.path.join(folder, "raw.safetensors")
        for number, source in enumerate(options.btf or options.materials.split(",")):
            name = os.path.splitext(os.path.basename(source))[0]
            if not options.btf:
                run(options.weft, "synth", "--material", name, "--size", str(options.size), "--view-set", "37",
                    "--light-set", "21", "--samples", str(options.samples), "--dtype", "u8", "-o", raw)
                source = raw
            shape = run(options.weft, "info", source)["files"][0]["shape"]
            images = []
            pictured = options.picture and number == 0
            if pictured:
                images.append(("original", image_of(options.weft, source, options, folder)))
            for label, count, how in models_of(shape):
                report = run(options.weft, "compress", source, "-o", model, "--ssim", *how)
                errors = report["errors"]
                print(f"| {name}, {label} | {count} | {report['file_size'] / 2**20:.2f} "
                      f"| {errors['rmse']:.4f} | {errors['ssim']:.3f} |", flush=True)
                if pictured:
                    images.append((label, image_of(options.weft, model, options, folder)))
            if pictured:
                draw(options.picture, images)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError) as error:
        sys.exit(f"strategic_reduction.py: error: {error}")
