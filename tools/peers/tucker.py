#!/usr/bin/python3
"""Tucker decomposition of a raw BTF by weft's ST-HOSVD and by TensorLy's partial_tucker, and the decoding of
all images by weft and by NumPy's einsum; in turn, on the same data.

    sh tools/setup.sh --peers
    env -u OPENBLAS_CORETYPE OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 /usr/bin/python3 \
      tools/peers/tucker.py WEFT cloth.safetensors [--target rel=0.02] [--merge yxc] [--rounds 3]

The ranks are those that weft chooses for the target; both sides are then given them. weft's time is that of
its encoder from the file (scan, norm, Gram matrices, products, rounding, measured error); TensorLy's that
of partial_tucker on the float32 tensor in memory, reading and conversion left out, and stopped after its
start (HOSVD), before iterations make it slower; with its default SVD and with the randomised one.

einsum gets the factors of weft's model and the best of its paths; all images at once, or view by view
where that is faster. weft's decoder leaves its images on the device; neither writes them anywhere.
"""
import argparse
import os
import tempfile
import time

import numpy
from tensorly.decomposition import partial_tucker

from weft_files import model_values, print_times, raw_values, run


def grouped(values, merge):
    """v, l, y, x, c as a tensor of the modes that weft's model has, and their names."""
    v, l, y, x, c = values.shape
    if merge == "yxc":
        return values.reshape(v, l, y * x * c), ["v", "l", "yxc"]
    return numpy.ascontiguousarray(values.transpose(0, 1, 4, 2, 3)), ["v", "l", "c", "y", "x"]


def seconds_of(work):
    start = time.monotonic()
    work()
    return time.monotonic() - start


def einsum_decoders(values, names):
    """All images from core and factors by one einsum, and by one for each view."""
    rows, columns = "ABCDE"[:len(names)], "abcde"[:len(names)]
    core, out, terms, factors = "", "", [], []
    for n, name in enumerate(names):
        factor = values.get("factor." + name)
        core += rows[n] if factor is None else columns[n]
        out += rows[n]
        if factor is not None:
            terms.append(rows[n] + columns[n])
            factors.append(factor)

    def decoder(output, some):
        subscripts = ",".join([core, *terms]) + "->" + output
        operands = [values["core"], *some]
        path = numpy.einsum_path(subscripts, *operands, optimize="optimal")[0]
        return lambda parts: numpy.einsum(subscripts, values["core"], *parts, optimize=path)

    whole = decoder(out, factors)
    one = decoder(out, [factors[0][:1], *factors[1:]])

    def by_view():
        for view in range(factors[0].shape[0]):
            one([factors[0][view:view + 1], *factors[1:]])

    return {"einsum, all at once": lambda: whole(factors), "einsum, view by view": by_view}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("weft")
    parser.add_argument("btf")
    parser.add_argument("--target", default="rel=0.02")
    parser.add_argument("--merge", default="", choices=["", "yxc"])
    parser.add_argument("--ranks", help="as v=61,l=27, instead of a target")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--svd", default="truncated_svd,randomized_svd", help="of TensorLy")
    parser.add_argument("--skip", default="", help="encode or decode")
    options = parser.parse_args()

    data, names = grouped(raw_values(options.btf), options.merge)
    norm = float(numpy.linalg.norm(data.ravel()))
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        model = os.path.join(folder, "model.weft")
        common = ["compress", options.btf, "--codec", "tucker", "--memory", "8GiB", "-o", model]
        if options.merge:
            common += ["--merge", options.merge]
        goal = ["--ranks", options.ranks] if options.ranks else ["--target", options.target]
        chosen = run(options.weft, *common, *goal)
        ranks = chosen["parameters"]["ranks"]
        given = ",".join(f"{name}={rank}" for name, rank in ranks.items())
        modes = [n for n, name in enumerate(names) if ranks[name] < data.shape[n]]
        print(f"{options.btf}: {' x '.join(map(str, data.shape))}, ranks {given}")
        solvers = options.svd.split(",")
        times = {"weft": [], **{f"TensorLy, {svd}": [] for svd in solvers}}
        errors = {}
        for _ in range(0 if options.skip == "encode" else options.rounds):
            report = run(options.weft, *common, "--ranks", given)
            times["weft"].append(report["encode_time"])
            errors["weft"] = report["errors"]["relative"]
            for svd in solvers:
                name = f"TensorLy, {svd}"
                start = time.monotonic()
                (core, _), _ = partial_tucker(data, rank=[ranks[names[n]] for n in modes], modes=modes,
                                              n_iter_max=0, init="svd", svd=svd)
                times[name].append(time.monotonic() - start)
                errors[name] = max(norm**2 - float(numpy.linalg.norm(core.ravel()))**2, 0)**0.5 / norm
        if errors:
            print("encoding; relative errors " + ", ".join(f"{n} {e:.5f}" for n, e in errors.items()))
            print_times(times, "weft")

        if options.skip == "decode":
            return
        # of the core, scales go with its first mode; of a factor with its columns
        values = model_values(model, lambda name: 0 if name == "core" else 1)
        peers = einsum_decoders(values, names)
        times = {"weft": [], **{name: [] for name in peers}}
        for _ in range(options.rounds):
            images = run(options.weft, "bench", "--model", model, "--filter", "images")["images"]
            times["weft"].append(images["decode_time"])
            for name, decode in peers.items():
                times[name].append(seconds_of(decode))
        print(f"decoding all {data.shape[0] * data.shape[1]} images")
        print_times(times, "weft")


if __name__ == "__main__":
    main()
