#!/bin/sh
# The whole way once, from a fresh clone on a bare Debian 12: installs what is missing, builds the
# program, synthesises a woven material, compresses it, decompresses it to EXR and PNG images, checks
# device against reference, and draws a contact sheet.
#
#   sh tools/demo.sh        results in demo-output/, about 300 MB
set -eu
cd "$(dirname "$0")/.."
jobs=$(nproc 2>/dev/null || echo 2)
output=demo-output
begin=$(date +%s)

say() { printf '\n=== %s\n' "$*"; }
# Prints a command as one would type it, and runs it.
run() {
  printf '$ weft %s\n' "$*"
  build/demo/tools/weft/weft "$@" </dev/null
}

say "packages"
sh tools/setup.sh

say "build"
launcher=
if command -v ccache >/dev/null 2>&1; then
  launcher=-DCMAKE_CXX_COMPILER_LAUNCHER=ccache
fi
cmake --preset release -B build/demo -DWEFT_BUILD_TESTS=OFF $launcher
cmake --build build/demo --target weft -j "$jobs"
built=$(date +%s)

rm -rf "$output"
mkdir -p "$output"
cloth=$output/cloth.safetensors
model=$output/cloth.weft
sheet=$output/contact-sheet.png

say "a woven cloth seen from 36 directions under 36 lights each"
run synth --material weave --size 128 --view-set 36 --light-set 36 --dtype f16 -o "$cloth"
say "compress it"
run compress "$cloth" --codec pca --rank 48 --memory 1GiB -o "$model"
say "decompress it to images"
run decompress "$model" --format exr -o "$output/exr"
run decompress "$model" --format png -o "$output/png"
say "check device against reference, and both against the original"
run verify "$model" --against "$cloth"
say "compare by eye"
run sheet "$cloth" "$model" --columns 8 --difference 4 -o "$sheet"

# A field of the model's report, by its name.
report=$(build/demo/tools/weft/weft info --json "$model")
field() { printf '%s' "$report" | sed -n "s/.*\"$1\":\"\\{0,1\\}\\([^,\"}]*\\).*/\\1/p"; }
count() { find "$1" -name "*.$2" | wc -l; }

say "summary"
printf 'build                     %s s\n' $((built - begin))
printf 'everything after it       %s s\n' $(($(date +%s) - built))
printf 'original                  %s bytes\n' "$(wc -c <"$cloth")"
printf 'model                     %s bytes, ratio %.1f\n' "$(wc -c <"$model")" "$(field ratio)"
printf 'error of the model        PSNR %.1f dB, RMSE %.2e\n' "$(field psnr)" "$(field rmse)"
printf 'images                    %s EXR, %s PNG\n' "$(count "$output/exr" exr)" "$(count "$output/png" png)"
printf 'device against reference  within tolerance\n'
printf 'contact sheet             %s\n' "$PWD/$sheet"
printf '  rows: original, decoded, difference x 4\n'
