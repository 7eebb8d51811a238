#!/usr/bin/python3
"""Orthogonal matching pursuit by weft, by scikit-learn's orthogonal_mp_gram and, where it is installed,
by SPAMS, among 256 atoms of dimension 300.

Debian: apt-get install python3-sklearn. SPAMS, optional: tools/setup.sh --peers. All with two threads:

  env -u OPENBLAS_CORETYPE OMP_NUM_THREADS=2 OPENBLAS_NUM_THREADS=2 \
    /usr/bin/python3 tools/peers/sparse_coding.py WEFT [ROUNDS]

weft's rates are those of its benchmark rows omp_pursuit, from correlations, and omp_code, from signals.
scikit-learn is given the Gram matrix and the correlations, and fewer signals, since it takes them one by
one in Python; SPAMS is given signals, and computes correlations itself.
"""
import json
import subprocess
import sys
import time

import numpy
from sklearn.linear_model import orthogonal_mp_gram

ATOMS, DIMENSION, SIGNALS = 256, 300, 100000
SKLEARN_SIGNALS = 1000


def fastest(rounds, run):
    times = []
    for _ in range(rounds):
        start = time.monotonic()
        run()
        times.append(time.monotonic() - start)
    return min(times)


def weft_rates(weft):
    """Signals per second of (row, k)."""
    output = subprocess.run([weft, "bench", "--filter", "omp_", "--quiet", "--json"], check=True,
                            capture_output=True).stdout
    rates = {}
    for row in json.loads(output)["operations"]:
        k = int(row["shape"].rsplit(" ", 1)[1])
        rates[row["operation"], k] = SIGNALS / (row["least_ms"] * 1e-3)
    return rates


def main():
    weft = sys.argv[1]
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    generator = numpy.random.default_rng(1)
    atoms = generator.uniform(-1, 1, (ATOMS, DIMENSION)).astype(numpy.float32)
    atoms /= numpy.linalg.norm(atoms, axis=1, keepdims=True)
    signals = generator.uniform(-1, 1, (SIGNALS, DIMENSION)).astype(numpy.float32)
    gram = atoms @ atoms.T
    correlations = atoms @ signals[:SKLEARN_SIGNALS].T
    try:
        import spams
    except ImportError:
        spams = None
    rates = weft_rates(weft)
    for k in (5, 10, 16):
        pursuit, code = rates["omp_pursuit", k], rates["omp_code", k]
        print(f"k {k:2}  weft          {pursuit:10.0f} signals/s, with correlations {code:10.0f}")
        seconds = fastest(rounds, lambda: orthogonal_mp_gram(gram, correlations, n_nonzero_coefs=k))
        rate = SKLEARN_SIGNALS / seconds
        print(f"      scikit-learn  {rate:10.0f} signals/s, weft {pursuit / rate:.0f} times as fast")
        if spams is None:
            continue
        columns = numpy.asfortranarray(signals.T)
        dictionary = numpy.asfortranarray(atoms.T)
        seconds = fastest(rounds, lambda: spams.omp(columns, dictionary, L=k, numThreads=2))
        rate = SIGNALS / seconds
        print(f"      SPAMS         {rate:10.0f} signals/s with correlations, "
              f"weft {code / rate:.2f} times as fast")


if __name__ == "__main__":
    main()
