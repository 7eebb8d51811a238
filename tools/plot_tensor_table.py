#!/usr/bin/python3
"""Draws what tensor_table.py measured: the error of each material's N-SVD and tensor trains over their size,
and over what one random texel takes.

    /usr/bin/python3 tools/plot_tensor_table.py table.json tensors.svg

Needs Matplotlib (Debian: python3-matplotlib).
"""
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

KINDS = {"nsvd": ("N-SVD", "s"), "tt1": ("TT (1): at its error", "o"), "tt2": ("TT (2): at its size", "^")}
COLOURS = ("#2d7dd2", "#c0392b", "#b9770e", "#1e8449", "#7d3c98", "#5d6d7e", "#d4ac0d", "#117a65", "#873600")


def draw(axis, tables, x):
    for (material, rows), colour in zip(tables.items(), COLOURS * 2):
        points = [(x(rows[kind]), rows[kind]["psnr"], kind) for kind in ("tt1", "nsvd", "tt2") if kind in rows]
        axis.plot([p[0] for p in points], [p[1] for p in points], color=colour, linewidth=0.8, alpha=0.5)
        for place, psnr, kind in points:
            axis.plot(place, psnr, linestyle="none", marker=KINDS[kind][1], markersize=5.5, color=colour,
                      markerfacecolor=colour if kind != "nsvd" else "white")
    axis.set_xscale("log")
    axis.grid(True, which="major", color="0.92", linewidth=0.6)
    axis.set_axisbelow(True)


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        tables = json.load(file)
    plt.rcParams.update({"svg.hashsalt": "weft", "font.size": 10})
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.6), sharey=True)
    draw(axes[0], tables, lambda row: row["bytes"] / 2**20)
    draw(axes[1], tables, lambda row: row["texel_ms"] * 1e3)
    axes[0].set_xlabel("model, MiB")
    axes[0].set_ylabel("PSNR, dB")
    axes[1].set_xlabel("one random texel, µs")
    handles = [plt.Line2D([], [], color=colour, linewidth=3, label=material)
               for material, colour in zip(tables, COLOURS * 2)]
    handles += [plt.Line2D([], [], color="0.3", linestyle="none", marker=marker, label=label,
                           markerfacecolor="white" if kind == "nsvd" else "0.3")
                for kind, (label, marker) in KINDS.items()]
    axes[1].legend(handles=handles, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False, fontsize=9)
    figure.tight_layout()
    is_svg = sys.argv[2].endswith(".svg")
    figure.savefig(sys.argv[2], dpi=100, metadata={"Date": None} if is_svg else None)


if __name__ == "__main__":
    main()
