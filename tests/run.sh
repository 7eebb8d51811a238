#!/bin/sh
# Builds Weft and runs its tests from a fresh clone:
#
#   sh tests/run.sh           everything
#   sh tests/run.sh --quick   without the sanitizers' build and the linter
#
# Stages: packages, release build, tests (among them the runs on the Oclgrind simulator), build with
# the address and undefined-behaviour sanitizers, its tests, lint. The last three wait for a budget of
# time, WEFT_TEST_SECONDS (25 minutes unless given): one that could not end within it is left out, and
# the summary says so.
set -u
cd "$(dirname "$0")/.." || exit 1

quick=no
[ "${1:-}" = --quick ] && quick=yes
budget=${WEFT_TEST_SECONDS:-1500}
begin=$(date +%s)
jobs=$(nproc 2>/dev/null || echo 2)
summary=

elapsed() { echo $(($(date +%s) - begin)); }

# stage NAME COMMAND...: runs it, notes its time, ends everything if it fails.
stage() {
  name=$1
  shift
  started=$(elapsed)
  echo
  echo "=== $name (after $started s)"
  "$@" </dev/null
  status=$?
  took=$(($(elapsed) - started))
  if [ $status -ne 0 ]; then
    finish "$name: FAILED with status $status after $took s"
    exit 1
  fi
  summary="$summary
  $name: passed in $took s"
}

finish() {
  echo
  echo "=== summary, $(elapsed) s in all$summary"
  [ $# -eq 0 ] || echo "  $1"
}

# room_for SECONDS NAME: whether a stage that takes so long still fits the budget.
room_for() {
  [ $(($(elapsed) + $1)) -le "$budget" ] && return 0
  summary="$summary
  $2: LEFT OUT, $(elapsed) s of $budget s were spent"
  return 1
}

configure() {
  launcher=
  if command -v ccache >/dev/null 2>&1; then
    launcher=-DCMAKE_CXX_COMPILER_LAUNCHER=ccache
  fi
  cmake --preset "$1" $launcher
}
build() { configure "$1" && cmake --build --preset "$1" -j "$jobs"; }

stage "packages" sh tools/setup.sh --tests
stage "release build" build release
release_build_took=$took
stage "release tests" ctest --preset release --no-tests=error --output-on-failure -j "$jobs"
release_tests_took=$took
if [ $quick = no ]; then
  # Compiling with sanitizers takes about one and a half times as long, running two to three times.
  if room_for $((release_build_took * 3 / 2 + release_tests_took * 3)) "sanitizers"; then
    stage "sanitizers build" build asan
    stage "sanitizers tests" ctest --preset asan --no-tests=error --output-on-failure -j "$jobs"
  fi
  # clang-tidy reads every file once more.
  if room_for $((release_build_took * 2)) "lint"; then
    stage "lint" cmake --build --preset release --target lint
  fi
fi
finish
