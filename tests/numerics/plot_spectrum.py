#!/usr/bin/env python3
"""Plots what `weft_numerics --spectrum` prints: computed singular values, and their errors, over the
true ones.

    weft_numerics --spectrum | /usr/bin/python3 plot_spectrum.py numerics.svg

Needs Matplotlib (Debian: python3-matplotlib).
"""
import csv
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

METHODS = {"gram": ("#c0392b", "s"), "randomized": ("#2d7dd2", "^"), "qr": ("#1e8449", "o")}
ROUNDOFF = {"f32": 2.0**-24, "f64": 2.0**-53}
LIMITS = (4, 2e-13)


def draw(axis, x, y, method, label=None):
    colour, marker = METHODS[method]
    axis.plot(x, y, linestyle="none", marker=marker, markersize=5, markerfacecolor="none",
              color=colour, label=label)


def draw_arithmetic(values, errors, arithmetic, rows):
    true = [float(row["true"]) for row in rows]
    values.plot(LIMITS, LIMITS, color="0.6", linewidth=1, label="exact")
    for method in METHODS:
        found = [(x, float(row[method])) for x, row in zip(true, rows) if row[method]]
        x = [x for x, _ in found]
        draw(values, x, [y for _, y in found], method, f"{method}: {len(found)} of {len(rows)} found")
        # a value that was given up counts as zero; an exact one has no place on the axis
        draw(errors, true[: len(x)], [max(abs(y - t) / t, 1e-16) for t, y in found], method)
        draw(errors, true[len(x):], [1.0] * (len(true) - len(x)), method)
    for axis in (values, errors):
        for position, text in (
            (ROUNDOFF[arithmetic] ** 0.5, "root of the\nroundoff"),
            (ROUNDOFF[arithmetic], "roundoff"),
        ):
            if position < LIMITS[1]:
                continue
            axis.axvline(position, color="0.7", linewidth=1, linestyle=":")
            if axis is values:
                axis.text(position * 0.7, LIMITS[0] * 0.5, text, va="top", ha="left", color="0.35",
                          fontsize=8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlim(*LIMITS)
        axis.grid(True, which="major", color="0.92", linewidth=0.6)
        axis.set_axisbelow(True)
    values.set_ylim(LIMITS[1], LIMITS[0])
    errors.set_ylim(3e-17, 30)
    values.set_title(arithmetic)
    values.legend(loc="lower left", framealpha=1, edgecolor="0.85", fontsize=9)
    errors.set_xlabel("true singular value")


def main():
    rows = list(csv.DictReader(sys.stdin))
    arithmetics = [a for a in ROUNDOFF if any(row["arithmetic"] == a for row in rows)]
    plt.rcParams.update({"svg.hashsalt": "weft", "font.size": 10})
    figure, axes = plt.subplots(
        2, len(arithmetics), figsize=(4.8 * len(arithmetics), 8), sharex=True, sharey="row",
        squeeze=False,
    )
    for column, arithmetic in enumerate(arithmetics):
        draw_arithmetic(axes[0][column], axes[1][column], arithmetic,
                        [row for row in rows if row["arithmetic"] == arithmetic])
    axes[0][0].set_ylabel("computed singular value")
    axes[1][0].set_ylabel("relative error")
    figure.tight_layout()
    is_svg = sys.argv[1].endswith(".svg")
    figure.savefig(sys.argv[1], dpi=100, metadata={"Date": None} if is_svg else None)


main()
