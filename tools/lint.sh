#!/bin/sh
# The style checks over all C++ files of the rooms: formatting, and clang-tidy for those of the
# library and the program that a build folder compiles.
#
#   sh tools/lint.sh --format         formatting alone
#   sh tools/lint.sh BUILD_FOLDER     formatting and clang-tidy
set -eu
cd "$(dirname "$0")/.."
if [ $# -ne 1 ]; then
  echo "usage: sh tools/lint.sh --format | BUILD_FOLDER" >&2
  exit 2
fi

find lib host tools tests \( -name '*.cpp' -o -name '*.hpp' \) -print0 |
  xargs -0 clang-format --dry-run -Werror
echo "lint: formatting is as .clang-format asks"
[ "$1" = --format ] && exit 0

# Tests are left to the compilers' warnings: GoogleTest's macros make clang-tidy ten times as slow.
# GCC's own warning options mean nothing to clang. Headers are checked through what includes them.
database=$1/compile_commands.json
[ -f "$database" ] || { echo "lint: $database is missing" >&2; exit 2; }
find lib host tools -name '*.cpp' | while read -r file; do
  # Only files of this build, which may leave out the program.
  if grep -q "\"file\": \"[^\"]*/$file\"" "$database"; then printf '%s\0' "$file"; fi
done | xargs -0 -n 4 -P "$(nproc)" \
  clang-tidy -p "$1" --quiet --extra-arg=-Wno-unknown-warning-option
echo "lint: clang-tidy has nothing to say"
