#!/usr/bin/python3
"""TT-SVD of a raw BTF by weft and by TensorLy's tensor_train, and the decoding of all images by weft and by
NumPy's einsum; in turn, on the same data.

    sh tools/setup.sh --peers
    env -u OPENBLAS_CORETYPE OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 /usr/bin/python3 \
      tools/peers/tensor_train.py WEFT cloth.safetensors [--target rel=0.1] [--rounds 3]

The ranks are those that weft chooses for the target, in the order x, y, c, v, l; both sides are then given
them. weft's time is that of its encoder from the file, rounding and measured error included; TensorLy's that
of tensor_train on the float32 tensor in memory, in that order already, with its default SVD and with the
randomised one.

einsum gets the cores of weft's model and the best of its paths; all images at once, or view by view where
that is faster. weft's decoder leaves its images on the device; neither writes them anywhere.
"""
import argparse
import os
import tempfile
import time

import numpy
from tensorly.decomposition import tensor_train

from weft_files import model_values, print_times, raw_values, run


def einsum_decoders(cores):
    """All images from the cores by one einsum, and by one for each view."""
    subscripts = "ixa,ayb,bcd,dve,elj->vlyxc"

    def decoder(parts):
        path = numpy.einsum_path(subscripts, *parts, optimize="optimal")[0]
        return lambda some: numpy.einsum(subscripts, *some, optimize=path)

    def with_view(view):
        return [*cores[:3], cores[3][:, view:view + 1], cores[4]]

    whole = decoder(cores)
    one = decoder(with_view(0))

    def by_view():
        for view in range(cores[3].shape[1]):
            one(with_view(view))

    return {"einsum, all at once": lambda: whole(cores), "einsum, view by view": by_view}


def seconds_of(work):
    start = time.monotonic()
    work()
    return time.monotonic() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("weft")
    parser.add_argument("btf")
    parser.add_argument("--target", default="rel=0.1")
    parser.add_argument("--ranks", help="R1,R2,R3,R4, instead of a target")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--svd", default="truncated_svd,randomized_svd", help="of TensorLy")
    parser.add_argument("--skip", default="", help="encode or decode")
    options = parser.parse_args()

    data = numpy.ascontiguousarray(raw_values(options.btf).transpose(3, 2, 4, 0, 1))
    squares = float(numpy.linalg.norm(data.ravel()))**2
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as folder:
        model = os.path.join(folder, "model.weft")
        common = ["compress", options.btf, "--codec", "tt", "--memory", "8GiB", "-o", model]
        goal = ["--ranks", options.ranks] if options.ranks else ["--target", options.target]
        kept = run(options.weft, *common, *goal)["parameters"]["kept"]
        given = ",".join(map(str, kept))
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
                cores = tensor_train(data, rank=[1, *kept, 1], svd=svd, random_state=0)
                times[name].append(time.monotonic() - start)
                # the cores on the left are orthonormal: what the last one lacks of the norm was cut
                kept_squares = float(numpy.linalg.norm(cores[-1].ravel()))**2
                errors[name] = max(squares - kept_squares, 0)**0.5 / squares**0.5
        if errors:
            print("encoding; relative errors " + ", ".join(f"{n} {e:.5f}" for n, e in errors.items()))
            print_times(times, "weft")

        if options.skip == "decode":
            return
        # a core's scales go with the bond on its right, the last one's with its only bond
        values = model_values(model, lambda name: 0 if name == "core.l" else 2)
        cores = [values["core." + mode] for mode in "xycvl"]
        peers = einsum_decoders(cores)
        times = {"weft": [], **{name: [] for name in peers}}
        for _ in range(options.rounds):
            images = run(options.weft, "bench", "--model", model, "--filter", "images")["images"]
            times["weft"].append(images["decode_time"])
            for name, decode in peers.items():
                times[name].append(seconds_of(decode))
        print(f"decoding all {data.shape[3] * data.shape[4]} images")
        print_times(times, "weft")


if __name__ == "__main__":
    main()
