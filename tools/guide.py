#!/usr/bin/env python3
"""The guide docs/choosing.md, from the results.json of `weft tradeoff`.

    python3 tools/guide.py [--run "COMMAND; COMMAND"] [-o docs/choosing.md] [--svg docs/choosing.svg]
                           [--without-times] RESULTS.json

Every figure of the guide is taken from the results; --run says how they were made. Needs NumPy.
"""
import argparse
import json
import math
import os
import sys

import numpy as np

COLOURS = ["#0072b2", "#d55e00", "#009e73", "#b0468f", "#b8860b", "#3d9bd6", "#5a5a5a", "#7a4cc2",
           "#8c564b"]
# Options that change how precisely the same model is made or kept, rather than what is modelled.
PRECISION = ["--storage", "--svd", "--arithmetic", "--update", "--method", "--device", "--transform"]

# What each codec is, and what to mind; measured figures stand in the tables.
CODECS = {
    "pca": ("The mean ABRDF and the principal components of the texels.",
            "A value takes k products. Coefficients cost what they replace where there are few images per "
            "texel; the basis holds whole ABRDFs, so that small textures do not become small files."),
    "view-pca": ("A mean and principal components for each view by itself.",
                 "A basis per view: large files. For where few views are shown at a time and `--rank` stays "
                 "small."),
    "lpca": ("Clusters of texels, each with a mean and principal components of its own.",
             "Each cluster brings a basis, which pays for large textures of a few kinds of texels. A local "
             "optimum: another `--seed` may find a slightly better one."),
    "tucker": ("N-mode SVD: a core and a factor per mode.",
               "Views, lights and texels are cut one by one, also later (`weft reduce`); a single texel takes "
               "the product of the ranks, images are decoded faster."),
    "tt": ("A tensor train: a chain of small cores, one per mode.",
           "A texel takes a few vector-matrix products; `weft compress MODEL --codec tt` cuts a train "
           "further without the material."),
    "cta": ("Clustered tensor approximation: each view belongs to one of several cores, with bases of its own for "
            "views, rows and columns.",
            "A value takes the small core of its cluster. Views of unlike clusters may differ visibly at their "
            "border."),
    "kcta": ("K-clustered tensor approximation: each view mixes K of several cores.",
             "K times the work of `cta` for a value, less error at the same size and softer borders; encoding "
             "iterates."),
    "sparse": ("Sparse tensor decomposition: a dictionary and two sparse tensors, by K-SVD.",
               "A value takes k1 k2 products. Encoding iterates; lists hold indices, which do not become "
               "fewer bits with `--storage`."),
    "vq": ("Multi-level vector quantisation: nested code-books of slices, and one index for each texel.",
           "A value is a chain of look-ups; texels that are alike share an entry, so that ratios grow with the size "
           "of the texture. Onion slices lose what lies between their nodes, whatever the threshold; `--grid "
           "measured` does not. Lights are sampled directly. Goals try thresholds, a fit "
           "each."),
}


def number(value):
    return {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}.get(value, value)


class Results:
    def __init__(self, path):
        with open(path, encoding="utf-8") as file:
            self.data = json.load(file)
        if self.data.get("format") != "weft tradeoff":
            raise ValueError(f"{path}: not written by weft tradeoff")
        measured = {point["material"] for point in self.data["points"]}
        self.materials = [material for material in self.data["materials"] if material["name"] in measured]
        self.points = [{**point, **{name: number(value) for name, value in point["figures"].items()}}
                       for point in self.data["points"]]
        self.done = [point for point in self.points if point["status"] == 0]
        self.codecs = list(dict.fromkeys(point["codec"] for point in self.points))

    def of(self, material, codec=None):
        return [point for point in self.done
                if point["material"] == material and codec in (None, point["codec"])]


def size_text(value):
    for unit in ("bytes", "KiB", "MiB"):
        if value < 1024:
            break
        value /= 1024
    else:
        unit = "GiB"
    return f"{value:.3g} {unit}" if value < 1000 else f"{value:.0f} {unit}"


def rate_text(value):
    for factor, letter in ((1e9, " G"), (1e6, " M"), (1e3, " k")):
        if value >= factor:
            return f"{value / factor:.3g}{letter}"
    return f"{value:.3g}"


def time_text(value):
    return f"{value:.2g} s" if value < 10 else f"{value:.0f} s"


def options_of(point):
    return " ".join(point["options"])


def command_of(point):
    return f"--codec {point['codec']} {options_of(point)}".strip()


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return lines + ["| " + " | ".join(row) + " |" for row in rows] + [""]


# The needs: what must hold, what is best then, and how it is written.
def needs(times):
    def snr(least):
        return lambda point: point["snr"] >= least

    stored = [
        ("a small file at SNR 15 dB", snr(15), lambda p: p["file_size"], lambda p: size_text(p["file_size"])),
        ("a small file at SNR 20 dB", snr(20), lambda p: p["file_size"], lambda p: size_text(p["file_size"])),
        ("a small error at ratio 100", lambda p: p["ratio"] >= 100, lambda p: -p["snr"],
         lambda p: f"SNR {p['snr']:.1f} dB"),
    ]
    timed = [
        ("quick encoding at SNR 15 dB", snr(15), lambda p: p["encode_time"],
         lambda p: time_text(p["encode_time"])),
        ("images decoded fast at SNR 15 dB", snr(15), lambda p: -p["image_rate"],
         lambda p: rate_text(p["image_rate"]) + " images/s"),
        ("random texels fast at SNR 15 dB", snr(15), lambda p: -p["lookup_rate"],
         lambda p: rate_text(p["lookup_rate"]) + "/s"),
        ("little memory for encoding at SNR 15 dB", snr(15), lambda p: p["peak_memory"],
         lambda p: size_text(p["peak_memory"])),
    ]
    return stored + timed if times else stored


def has(point, *names):
    return all(name in point for name in names)


def best_table(results, times):
    """Per need: how often each codec is best, and the best point of every material."""
    summary, details = [], []
    for name, holds, cost, text in needs(times):
        wins, row = {}, [name]
        for material in (m["name"] for m in results.materials):
            able = [p for p in results.of(material)
                    if has(p, "snr", "ratio", "image_rate", "lookup_rate") and holds(p)]
            if not able:
                row.append("none of the points")
                continue
            best = min(able, key=cost)
            wins[best["codec"]] = wins.get(best["codec"], 0) + 1
            row.append(f"`{best['codec']} {options_of(best)}`: {text(best)}")
        ordered = sorted(wins.items(), key=lambda item: -item[1])
        winners = ", ".join(f"`{codec}` ({count})" for codec, count in ordered) or "none of the points"
        summary.append([name, winners])
        details.append(row)
    return summary, details


def near_ratio(points, ratio):
    """The point of the smallest error with at least that ratio, or none."""
    able = [point for point in points if point["ratio"] >= ratio]
    return max(able, key=lambda point: point["snr"]) if able else None


def codec_table(results, ratio, times):
    rows = []
    for codec in results.codecs:
        chosen = [near_ratio(results.of(m["name"], codec), ratio) for m in results.materials]
        chosen = [point for point in chosen if point and has(point, "image_rate", "lookup_rate")]
        if not chosen:
            rows.append([f"`{codec}`", "0"] + ["–"] * (6 if times else 2))
            continue

        def median(name, of=chosen):
            return float(np.median([point[name] for point in of if name in point]))

        rows.append([f"`{codec}`", str(len(chosen)), f"{median('snr'):.1f} dB",
                     f"{median('ssim'):.3f}" if all("ssim" in p for p in chosen) else "–",
                     *([time_text(median("encode_time")), rate_text(median("image_rate")),
                        rate_text(median("lookup_rate")), size_text(median("peak_memory"))] if times else [])])
    return rows


def precision_rows(results, times):
    """Points that differ in one option of precision from another: what it changes, by medians."""
    by_options = {(p["material"], p["codec"], tuple(sorted(zip(p["options"][::2], p["options"][1::2])))): p
                  for p in results.done if len(p["options"]) % 2 == 0}
    changes = {}
    for (material, codec, options), point in by_options.items():
        for option in options:
            if option[0] not in PRECISION:
                continue
            rest = tuple(o for o in options if o != option)
            base = by_options.get((material, codec, rest))
            if base:
                label = (codec, " ".join(word for o in rest for word in o), " ".join(option))
                changes.setdefault(label, []).append((point, base))
    rows = []
    for (codec, rest, option), pairs in sorted(changes.items()):
        def ratio(name, of=pairs):
            return float(np.median([p[name] / b[name] for p, b in of if p.get(name) and b.get(name)] or [np.nan]))

        gain = float(np.median([p["snr"] - b["snr"] for p, b in pairs]))
        rows.append([f"`{codec} {rest}`", f"`{option}`", f"{ratio('file_size'):.2f}", f"{gain:+.2f} dB",
                     *([f"{ratio(name):.2g}" for name in ("encode_time", "image_rate", "peak_memory")]
                       if times else [])])
    return rows


def unmet_rows(results):
    return [[point["material"], f"`{point['codec']} {options_of(point)}`",
             point["message"].replace("|", "\\|")] for point in results.points if point["status"] != 0]


def front(points):
    best, kept = -math.inf, []
    for point in sorted(points, key=lambda p: (-p["ratio"], -p["snr"])):
        if point["snr"] > best:
            best = point["snr"]
            kept.append(point)
    return kept


def draw(results, path):
    """Ratio against SNR, a panel per material: the front of each codec."""
    width, height, gap, columns = 330, 250, 26, min(4, len(results.materials))
    rows = math.ceil(len(results.materials) / columns)
    done = [p for p in results.done if math.isfinite(p["snr"])]
    low, high = (f(math.log10(p["ratio"]) for p in done) for f in (min, max))
    bottom, top = (f(p["snr"] for p in done) for f in (min, max))

    def place(point):
        x = (math.log10(point["ratio"]) - low) / max(high - low, 1e-9)
        y = (point["snr"] - bottom) / max(top - bottom, 1e-9)
        return 46 + x * (width - 62), height - 38 - y * (height - 66)

    total = (max(columns * (width + gap) + gap, gap + 46 + 110 * len(results.codecs)), rows * (height + gap) + gap + 30)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total[0]} {total[1]}" '
           'font-family="sans-serif" font-size="12">',
           f'<rect width="{total[0]}" height="{total[1]}" fill="#fbfaf8"/>']
    for i, codec in enumerate(results.codecs):
        x = gap + 46 + 110 * i
        out.append(f'<line x1="{x}" x2="{x + 22}" y1="20" y2="20" stroke="{COLOURS[i % len(COLOURS)]}" stroke-width="3"/>'
                   f'<text x="{x + 28}" y="24">{codec}</text>')
    for i, material in enumerate(m["name"] for m in results.materials):
        out.append(f'<g transform="translate({gap + i % columns * (width + gap)},'
                   f'{gap + 14 + i // columns * (height + gap)})">')
        name = material.replace("&", "&amp;").replace("<", "&lt;")
        out.append(f'<text x="46" y="14" font-weight="bold">{name}</text>')
        for ratio in (1, 3, 10, 30, 100, 300, 1000, 3000, 10000):
            if low <= math.log10(ratio) <= high:
                x = place({"ratio": ratio, "snr": bottom})[0]
                out.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="28" y2="{height - 38}" stroke="#e4e1db"/>'
                           f'<text x="{x:.1f}" y="{height - 22}" text-anchor="middle" fill="#5b616b">{ratio}</text>')
        for snr in range(math.ceil(bottom / 5) * 5, math.floor(top) + 1, 5):
            y = place({"ratio": 10 ** low, "snr": snr})[1]
            out.append(f'<line x1="46" x2="{width - 16}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e4e1db"/>'
                       f'<text x="40" y="{y + 4:.1f}" text-anchor="end" fill="#5b616b">{snr}</text>')
        out.append(f'<text x="{width / 2 + 15}" y="{height - 6}" text-anchor="middle">ratio</text>'
                   f'<text transform="translate(14,{height / 2}) rotate(-90)" text-anchor="middle">SNR, dB</text>')
        for k, codec in enumerate(results.codecs):
            places = [place(p) for p in front([p for p in results.of(material, codec) if p in done])]
            line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
            out.append(f'<polyline points="{line}" fill="none" stroke="{COLOURS[k % len(COLOURS)]}" stroke-width="2"/>')
            out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{COLOURS[k % len(COLOURS)]}"/>' for x, y in places]
        out.append("</g>")
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(out + ["</svg>", ""]))


def guide(results, options):
    names = [m["name"] for m in results.materials]
    shapes = sorted({" x ".join(str(n) for n in m["shape"]) + f" ({m['dtype']})" for m in results.materials})
    times = not options.without_times
    summary, details = best_table(results, times)
    picture = os.path.relpath(options.svg, os.path.dirname(os.path.abspath(options.output)))
    text = [
        "# Choosing a codec", "",
        f"Which codec for which need, by {len(results.points)} measured points on {len(names)} simulated "
        f"material{'s' if len(names) != 1 else ''} ({', '.join(names)}; V x L x Y x X x C of {', '.join(shapes)}), on "
        f"{results.data['device'] or 'the reference'}. Other sizes, directions and machines give other figures: "
        "run the same on your material, and look at its page:", "",
        "```", "weft tradeoff MATERIAL.safetensors -o tradeoff && xdg-open tradeoff/index.html", "```", "",
        "Made by", "", "```", *[line.strip() for line in options.run.split(";") if line.strip()],
        "python3 tools/guide.py" + ("" if times else " --without-times") +
        f" -o docs/choosing.md --svg docs/choosing.svg {options.results}", "```", "",
        f"![Ratio against SNR]({picture})", "",
        "*Ratio of sizes against SNR: right and up is better. Lines join the points that no other of the codec "
        "beats.*", "",
        "## By need", "",
        f"On how many of {len(names)} each codec is best, of the points measured. An SNR of 15 dB "
        "is a relative error of 0.18, 20 dB one of 0.1.", "",
        *table(["need", "best (materials)"], summary),
        "The points behind it:", "",
        *table(["need", *names], details),
        "## By codec", "",
        "The point of least error at a ratio of at least 100, median over the materials (their number in the "
        "second column; the others have no such point)." + (
            " Rates are on the device, look-ups as they come; memory is that of the encoding process at its peak, "
            "with the OpenCL driver's and mapped pages of the input." if times else ""), "",
        *table(["codec", "materials", "SNR", "SSIM",
                *(["encoding", "images/s", "look-ups/s", "memory"] if times else [])],
               codec_table(results, 100, times)),
    ]
    for codec in results.codecs:
        what, mind = CODECS.get(codec, ("", ""))
        best = near_ratio([p for m in names[:1] for p in results.of(m, codec)], 100)
        text += [f"**`{codec}`**. {what} {mind}".strip(), ""]
        if best:
            text += ["```", f"weft compress {names[0]}.safetensors {command_of(best)} -o {names[0]}.weft", "```",
                     f"gives ratio {best['ratio']:.0f} and SNR {best['snr']:.1f} dB on `{names[0]}`.", ""]
    rows = precision_rows(results, times)
    if rows:
        text += ["## What precision costs", "",
                 "An option of precision beside the same point without it, median over the materials: factors, and "
                 "the difference of SNR.", "",
                 *table(["point", "with", "size", "SNR",
                         *(["encoding time", "images/s", "memory"] if times else [])], rows)]
    unmet = unmet_rows(results)
    if unmet:
        text += ["## What could not be done", "", *table(["material", "point", "why"], unmet)]
    text += ["## Limits", "",
             "- The figures are of the points measured: between them, and beyond, other parameters may do better.",
             "- Times are of one machine; sizes and errors repeat to the bit on equal devices." if times else
             "- Times, rates and memory are left out: the machine was busy with other work. Sizes and errors repeat to "
             "the bit on equal devices.",
             "- Errors are pooled over all values in the stored encoding. What an eye sees in them is in the page's "
             "pictures.", ""]
    return "\n".join(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("results", help="results.json of weft tradeoff")
    parser.add_argument("--run", default="weft tradeoff MATERIAL... -o tradeoff",
                        help="the commands that made the results, separated by ;")
    parser.add_argument("-o", "--output", default="docs/choosing.md")
    parser.add_argument("--svg", default="docs/choosing.svg")
    parser.add_argument("--without-times", action="store_true",
                        help="leave out times, rates and memory, as of a busy machine")
    options = parser.parse_args()
    results = Results(options.results)
    if not results.done:
        raise ValueError(f"{options.results}: has no point that was measured")
    draw(results, options.svg)
    with open(options.output, "w", encoding="utf-8") as file:
        file.write(guide(results, options))


if __name__ == "__main__":
    try:
        main()
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"guide.py: error: {error}")
