#!/bin/sh
# Measures how well `pca` compresses every simulated material, as the table of docs/materials.md:
# sh tools/materials_table.sh [WEFT [SIZE [DIRECTIONS]]]
set -eu
weft=${1:-build/release/tools/weft/weft}
size=${2:-64}
directions=${3:-ubo81}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
# The value of a number in a JSON report: value KEY < report
value() { tr -d '\n' | sed "s/.*\"$1\": *\([0-9.eE+-]*\).*/\1/"; }

echo '| material | k = 4 | k = 16 | k = 64 |'
echo '|---|---|---|---|'
for material in $("$weft" synth --list | cut -d ' ' -f 1); do
  raw=$folder/$material.safetensors
  "$weft" synth --material "$material" --size "$size" --view-set "$directions" \
    --light-set "$directions" --quiet -o "$raw"
  row="| $material"
  for rank in 4 16 64; do
    "$weft" compress "$raw" --codec pca --rank "$rank" --json --quiet -o "$folder/model.weft" \
      > "$folder/pca.json"
    row="$row$(printf ' | %.3f, %.1f dB, %.0f' "$(value relative < "$folder/pca.json")" \
      "$(value psnr < "$folder/pca.json")" "$(value ratio < "$folder/pca.json")")"
  done
  echo "$row |"
  rm -f "$raw"
done
