#!/usr/bin/env python3
"""Quantised and entropy-coded models beside half storage, at equal error, for every codec.

For each raw BTF given, or for every material that `weft synth --list` names if none is (64 x 64 texels,
41 x 41 directions, 8 bits): each codec with fixed parameters, stored as f16 and by --storage auto.

    python3 tools/storage_table.py [--weft PROGRAM] [--results table.json] [BTF ...]

Rows that are in the results are not measured again. Prints Markdown: sizes and SNR, how much of the gain is
by quantisation (the codes packed at their tensors' bits) and how much by entropy coding, the seconds of
encoding, and those of reading the model with all its checks.
"""
import argparse
import json
import os
import struct
import tempfile
import time

from measure import load, materials as known_materials, run, save

CODECS = {
    "pca": ["--rank", "32"],
    "view-pca": ["--rank", "8"],
    "lpca": ["--clusters", "16", "--rank", "8"],
    "sparse": ["--k1", "5", "--k2", "8"],
    "kcta": [],
    "tucker": ["--ranks", "v=24,l=24,y=40,x=40,c=3"],
    "tt": ["--rank", "64"],
}


def packed_size(path):
    """Bytes of the file if its blobs were codes packed at their bits."""
    with open(path, "rb") as file:
        length = struct.unpack("<Q", file.read(8))[0]
        header = json.loads(file.read(length))
    size = os.path.getsize(path)
    for name, tensor in json.loads(header["__metadata__"].get("coded", "{}")).items():
        count = 1
        for n in tensor["shape"]:
            count *= n
        bits = tensor.get("bits", {"U8": 8, "U16": 16, "U32": 32}.get(tensor["dtype"]))
        begin, end = header[name]["data_offsets"]
        size += (count * bits + 7) // 8 - (end - begin)
    return size


def measure(weft, raw, codec, storage, folder):
    path = os.path.join(folder, "model.weft")
    report = run(weft, "compress", raw, "--codec", codec, *CODECS[codec], "--storage", storage, "-o", path)
    begin = time.perf_counter()
    run(weft, "info", path)
    return {
        "bytes": report["file_size"],
        "snr": report["errors"]["snr"],
        "storage": report["storage"],
        "encode": report["encode_time"],
        "load": time.perf_counter() - begin,
        "packed": packed_size(path),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--weft", default="weft")
    parser.add_argument("--results")
    parser.add_argument("raw", nargs="*")
    options = parser.parse_args()
    rows = load(options.results)

    with tempfile.TemporaryDirectory() as folder:
        materials = {os.path.splitext(os.path.basename(raw))[0]: raw for raw in options.raw}
        if not materials:
            materials = {name: None for name in known_materials(options.weft)}
        for name, raw in materials.items():
            for codec in CODECS:
                for storage in ("f16", "auto"):
                    key = f"{name} {codec} {storage}"
                    if key in rows:
                        continue
                    if raw is None:
                        raw = os.path.join(folder, name + ".safetensors")
                        run(options.weft, "synth", "--material", name, "--size", "64", "--view-set", "41",
                            "--light-set", "41", "--samples", "2", "--dtype", "u8", "-o", raw)
                    rows[key] = measure(options.weft, raw, codec, storage, folder)
                    save(options.results, rows)

    print("| material | codec | f16, KiB | SNR, dB | auto, KiB | SNR, dB | f16 / auto | by quantising | by coding "
          "| bits | encode f16, s | encode auto, s | read f16, s | read auto, s |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name in materials:
        for codec in CODECS:
            half, auto = rows[f"{name} {codec} f16"], rows[f"{name} {codec} auto"]
            print(f"| {name} | {codec} | {half['bytes'] / 1024:.0f} | {half['snr']:.2f} | "
                  f"{auto['bytes'] / 1024:.0f} | {auto['snr']:.2f} | {half['bytes'] / auto['bytes']:.2f} | "
                  f"{half['bytes'] / auto['packed']:.2f} | {auto['packed'] / auto['bytes']:.2f} | "
                  f"{auto['storage'].removeprefix('q=')} | {half['encode']:.2f} | {auto['encode']:.2f} | "
                  f"{half['load']:.2f} | {auto['load']:.2f} |")


if __name__ == "__main__":
    main()
