#!/bin/sh
# Draws the contact sheet of all simulated materials, docs/materials.png: from two views, nearly from
# above and slanting, each under two lights. sh tools/materials_sheet.sh [WEFT [OUTPUT.png]]
set -eu
weft=${1:-build/release/tools/weft/weft}
output=${2:-docs/materials.png}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/rows"

# Each material's own sheet, with an exposure of its own, is one picture; `light` only numbers them.
echo 'file,light_theta,light_phi' > "$folder/rows/manifest.csv"
number=0
for material in $("$weft" synth --list | cut -d ' ' -f 1); do
  "$weft" synth --material "$material" --size 128 --view-set 2 --light-set 2 --samples 16 --quiet \
    -o "$folder/raw.safetensors"
  "$weft" sheet "$folder/raw.safetensors" --views all --lights all --quiet \
    -o "$folder/rows/$material.png"
  echo "$material.png,$number,0" >> "$folder/rows/manifest.csv"
  number=$((number + 5))
done
"$weft" import "$folder/rows" --quiet -o "$folder/rows.safetensors"
"$weft" sheet "$folder/rows.safetensors" --views all --lights all --per-row 2 --quiet -o "$output"
