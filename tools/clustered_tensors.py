#!/usr/bin/python3
"""N-SVD, CTA and K-CTA side by side: Table I and figure 5(a) of Tsai & Shih 2012 on simulated materials.

For every material, at the same total view rank and the same ranks of other modes: the N-mode SVD, hard
clusters, and clusters of which three are mixed. Then the error over the total view rank for one to four
mixed clusters; the random access and pictures of K-CTA beside those of the N-SVD and of sparse tensors at
its error; and how far the error of a picture jumps from one frame of a turntable to the next.

    /usr/bin/python3 tools/clustered_tensors.py [--weft build/release/tools/weft/weft]
                    [--json clusters.json] [--svg clusters.svg] [--size 128] [--samples 16]
                    [--materials corduroy,knit,gravel,net,weave] [--curve corduroy]
                    [--parts table,curve,rates,turntable] [--table-only]

Every run is added to the JSON file as soon as it is done, and runs that are in it already are not repeated.
Printed are Markdown tables. Needs Matplotlib (Debian: python3-matplotlib) for the SVG and the turntable.
"""
import argparse
import os
import sys
import tempfile

from measure import load, run, save

PARTS = ("table", "curve", "rates", "turntable")
TOTAL = 32  # view rank, as the paper has it for its corduroy
TOTALS = (8, 16, 24, 32, 48, 64)
OF_CLUSTER = 4
LIGHTS = 20
GRID = 256  # side of the resampled views
FRAMES = 120
WITH_HOLES = ("net",)


def codec_options(mixtures, total, side):
    """Of the N-SVD for no mixtures, CTA for one, K-CTA for more."""
    texels = f"lc={LIGHTS},y={side},x={side}"
    if mixtures == 0:
        return ["--codec", "tucker", "--merge", "lc", "--ranks", f"v={total},{texels}"]
    clusters = ["--clusters", str(total // OF_CLUSTER), "--ranks", f"v={OF_CLUSTER},{texels}"]
    if mixtures == 1:
        return ["--codec", "cta", *clusters]
    return ["--codec", "kcta", "--mixtures", str(mixtures), *clusters]


class Runs:
    """What is measured, by key, and the files it is measured of, made when they are needed."""

    def __init__(self, options, folder):
        self.options, self.folder = options, folder
        self.rows = load(options.json)
        self.material = None
        self.models = {}
        self.originals = {}  # frames

    def path(self, name):
        return os.path.join(self.folder, name)

    def weft(self, *arguments):
        return run(self.options.weft, *arguments)

    def raw(self, material):
        """The raw BTF of a material; that of one is kept at a time."""
        path = self.path("raw.safetensors")
        if self.material != material:
            self.models.clear()
            self.weft("synth", "--material", material, "--size", str(self.options.size), "--samples",
                      str(self.options.samples), "--dtype", "u8", "-o", path)
            self.material = material
        return path

    def model(self, material, codec):
        """A model of a material and what was said of it."""
        raw = self.raw(material)
        key = " ".join(codec)
        if key not in self.models:
            path = self.path(f"m{len(self.models)}.weft")
            self.models[key] = path, self.weft("compress", raw, *codec, "--memory", self.options.memory, "-o", path)
        return self.models[key]

    def measure(self, *key, work):
        name = "|".join([f"{self.options.size} x {self.options.size}, {self.options.samples}", *key])
        if name not in self.rows:
            self.rows[name] = work()
            save(self.options.json, self.rows)
            print(name, self.rows[name], file=sys.stderr, flush=True)

    def select(self, part):
        start = f"{self.options.size} x {self.options.size}, {self.options.samples}|{part}|"
        return {tuple(key.split("|")[2:]): row for key, row in self.rows.items() if key.startswith(start)}


def fit(runs, material, mixtures, total, side):
    path, report = runs.model(material, codec_options(mixtures, total, side))
    return path, {"bytes": report["file_size"], "snr": report["errors"]["snr"], "encode_s": report["encode_time"]}


def mask_options(mixtures, side):
    """The same for masks (v, y, x)."""
    if mixtures == 0:
        return f"tucker --ranks v={TOTAL},y={side},x={side}"
    clusters = f"--clusters {TOTAL // OF_CLUSTER} --ranks v={OF_CLUSTER},y={side},x={side}"
    return f"cta {clusters}" if mixtures == 1 else f"kcta --mixtures {mixtures} {clusters}"


def table_row(runs, material, mixtures):
    side = runs.options.size * 5 // 8  # 80 of 128
    path, row = fit(runs, material, mixtures, TOTAL, side)
    speed = runs.weft("bench", "--model", path, "--filter", "images")
    row["images_per_s"] = speed["images"]["rate"]
    if material in WITH_HOLES:
        for kind in ("mask", "distance"):
            report = runs.weft("compress", runs.raw(material), "--rank", "1", "--occlusion", mask_options(mixtures, side),
                               "--occlusion-of", kind, "--memory", runs.options.memory, "-o", runs.path("mask.weft"))
            row[f"error_texels_{kind}"] = report["occlusion"]["error_texel_share"]
    return row


def rates_row(runs, material, codec):
    """Of K-CTA with a grid of views and without, and of others at its error."""
    side = runs.options.size
    _, clusters = fit(runs, material, 3, TOTAL, side)
    goal = ["--target", f"snr={clusters['snr']}"]
    options = {
        "kcta": codec_options(3, TOTAL, side),
        "kcta, resampled": [*codec_options(3, TOTAL, side), "--resample-views", str(GRID)],
        "tucker": ["--codec", "tucker", "--merge", "lc", *goal],
        "sparse": ["--codec", "sparse", *goal],
    }
    path, report = runs.model(material, options[codec])
    looked_up = runs.weft("bench", "--model", path, "--filter", "look_ups")["look_ups"]
    frames = runs.path("frames")
    shown = runs.weft("render", path, "--size", "512", "--samples", "1", "--light", "30,45", "--turntable", "4", "-o", frames)
    for name in os.listdir(frames):
        os.remove(os.path.join(frames, name))
    os.rmdir(frames)
    return {"bytes": report["file_size"], "snr": report["errors"]["snr"], "look_ups": looked_up["unsorted"],
            "filtered": looked_up["filtered"], "frames_per_s": shown["frames_per_second"]}


def pictures(runs, source, name):
    """The frames of a turntable of a plane, as display values."""
    import matplotlib.image
    folder = runs.path(name)
    runs.weft("render", source, "--shape", "plane", "--repeat", "1", "--size", "64", "--samples", "1",
              "--light", "0,0", "--exposure", "0", "--turntable", str(FRAMES), "-o", folder)
    return [matplotlib.image.imread(os.path.join(folder, file))[:, :, :3] for file in sorted(os.listdir(folder))]


def turntable_row(runs, material, kind):
    """How the error of a frame differs from that of the frame before, RMS; the error is that of a plane under
    light from above against the same from a material that is sampled at thousands of views."""
    import numpy
    side = runs.options.size
    mixtures = 3 if kind.startswith("kcta") else 1
    codec = codec_options(mixtures, TOTAL, side)
    if kind.endswith("resampled"):
        codec += ["--resample-views", str(GRID)]
    path, _ = runs.model(material, codec)
    if material not in runs.originals:
        # the material itself, seen from close views, under the light that all sets have
        dense = runs.path("dense.safetensors")
        runs.weft("synth", "--material", material, "--size", str(side), "--samples", str(runs.options.samples),
                  "--dtype", "u8", "--view-set", "1500", "--light-set", "1", "-o", dense)
        runs.originals[material] = pictures(runs, dense, f"originals-{material}")
    shown = pictures(runs, path, kind.replace(", ", "-"))
    errors = [one - other for one, other in zip(shown, runs.originals[material])]
    jumps = [float(numpy.sqrt(numpy.mean((errors[i] - errors[i - 1]) ** 2))) for i in range(len(errors))]
    return {"jumps": jumps, "error": float(numpy.sqrt(numpy.mean(numpy.square(errors))))}


def measure(runs):
    options = runs.options
    for material in options.materials.split(","):
        if "table" in options.parts:
            for mixtures in (0, 1, 3):
                runs.measure("table", material, str(mixtures), work=lambda: table_row(runs, material, mixtures))
        if "curve" in options.parts and material in options.curve.split(","):
            for total in TOTALS:
                for mixtures in range(min(4, total // OF_CLUSTER) + 1):
                    runs.measure("curve", material, str(total), str(mixtures),
                                 work=lambda: fit(runs, material, mixtures, total, options.size)[1])
        if "rates" in options.parts:
            for codec in ("kcta, resampled", "kcta", "tucker", "sparse"):
                runs.measure("rates", material, codec, work=lambda: rates_row(runs, material, codec))
        if "turntable" in options.parts and material in options.curve.split(","):
            for kind in ("cta", "cta, resampled", "kcta", "kcta, resampled"):
                runs.measure("turntable", material, kind, work=lambda: turntable_row(runs, material, kind))


def name_of(mixtures):
    return {"0": "N-SVD", "1": "CTA"}.get(mixtures, f"K-CTA, K = {mixtures}")


def print_tables(runs):
    table, curve = runs.select("table"), runs.select("curve")
    if table:
        print("| material | | MiB | SNR dB | encoding s | images/s | error texels: mask, distance |")
        print("|---|---|---|---|---|---|---|")
    for (material, mixtures), row in table.items():
        wrong = [row.get("error_texels_" + kind) for kind in ("mask", "distance")]
        print(f"| {material} | {name_of(mixtures)} | {row['bytes'] / 2**20:.2f} | {row['snr']:.2f} "
              f"| {row['encode_s']:.1f} | {row['images_per_s']:.0f} "
              f"| {', '.join(f'{100 * share:.2f} %' for share in wrong) if None not in wrong else '-'} |")
    for material in dict.fromkeys(key[0] for key in curve):
        kinds = sorted({key[2] for key in curve if key[0] == material})
        print(f"\n| {material}: total view rank | " + " | ".join(name_of(kind) for kind in kinds) + " |")
        print("|---" * (len(kinds) + 1) + "|")
        for total in TOTALS:
            cells = [curve.get((material, str(total), kind)) for kind in kinds]
            if any(cells):
                print(f"| {total} | " + " | ".join(f"{cell['snr']:.2f}" if cell else "-" for cell in cells) + " |")
    rates = runs.select("rates")
    if rates:
        print("\n| material | codec | MiB | SNR dB | look-ups/s | filtered ones/s | frames/s |")
        print("|---|---|---|---|---|---|---|")
    for (material, codec), row in rates.items():
        print(f"| {material} | {codec} | {row['bytes'] / 2**20:.2f} | {row['snr']:.2f} "
              f"| {row['look_ups'] * 1e-6:.1f} M | {row['filtered'] * 1e-6:.2f} M | {row['frames_per_s']:.2f} |")
    turntable = runs.select("turntable")
    if turntable:
        print("\n| material | codec | error, RMS | largest jump | median jump |\n|---|---|---|---|---|")
    for (material, kind), row in turntable.items():
        jumps = sorted(row["jumps"])
        print(f"| {material} | {kind} | {row['error']:.4f} | {jumps[-1]:.4f} | {jumps[len(jumps) // 2]:.4f} |")


def draw(runs, path):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    plt.rcParams.update({"svg.hashsalt": "weft", "font.size": 10})
    colours = {"0": "#2c3e50", "1": "#c0392b", "2": "#b9770e", "3": "#2d7dd2", "4": "#1e8449"}
    curve, turntable = runs.select("curve"), runs.select("turntable")
    material = next(iter(curve), (runs.options.curve.split(",")[0],))[0]
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2))
    for kind in sorted({key[2] for key in curve if key[0] == material}):
        points = [(total, curve[material, str(total), kind]["snr"]) for total in TOTALS
                  if (material, str(total), kind) in curve]
        axes[0].plot(*zip(*points), color=colours[kind], marker="os^vD"[int(kind)], markersize=4, linewidth=1.4,
                     linestyle="--" if kind == "0" else "-", label=name_of(kind))
    axes[0].set_xlabel(f"total view rank ({material})")
    axes[0].set_ylabel("SNR, dB")
    styles = {"cta": ("#c0392b", "--"), "cta, resampled": ("#c0392b", "-"), "kcta": ("#2d7dd2", "--"),
              "kcta, resampled": ("#2d7dd2", "-")}
    for (of, kind), row in turntable.items():
        if of == material:
            degrees = [360 * i / len(row["jumps"]) for i in range(len(row["jumps"]))]
            axes[1].plot(degrees, row["jumps"], color=styles[kind][0], linestyle=styles[kind][1], linewidth=1,
                         label=kind.replace("kcta", "K-CTA").replace("cta", "CTA"))
    axes[1].set_xlabel("azimuth of the camera, degrees")
    axes[1].set_ylabel("change of the error between frames, RMS")
    for axis in axes:
        axis.grid(True, color="0.92", linewidth=0.6)
        axis.set_axisbelow(True)
        if axis.lines:
            axis.legend(frameon=False, fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=100, metadata={"Date": None} if path.endswith(".svg") else None)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weft", default="build/release/tools/weft/weft")
    parser.add_argument("--json", default="clusters.json")
    parser.add_argument("--svg", help="figure to draw")
    parser.add_argument("--size", type=int, default=128, help="texels along a side")
    parser.add_argument("--samples", type=int, default=16, help="rays per texel; noise hides what clusters do")
    parser.add_argument("--materials", default="corduroy,knit,gravel,net,weave")
    parser.add_argument("--curve", default="corduroy", help="materials of the curve and the turntable")
    parser.add_argument("--parts", default=",".join(PARTS), help="of " + ", ".join(PARTS))
    parser.add_argument("--memory", default="4GiB")
    parser.add_argument("--table-only", action="store_true", help="print and draw what is measured")
    options = parser.parse_args()
    options.parts = options.parts.split(",")
    if not set(options.parts) <= set(PARTS):
        parser.error(f"--parts {','.join(options.parts)}: {', '.join(PARTS)} are known")
    with tempfile.TemporaryDirectory() as folder:
        runs = Runs(options, folder)
        if not options.table_only:
            measure(runs)
        print_tables(runs)
        if options.svg:
            draw(runs, options.svg)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (RuntimeError, OSError) as error:
        sys.exit(f"clustered_tensors.py: error: {error}")
