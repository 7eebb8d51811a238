#!/bin/sh
# Runs a program on the Oclgrind simulator, which checks every access of every work-item, and fails on
# any report. Oclgrind's own exit status is 0 even when it found something, so its log decides.
#
#   run_oclgrind.sh OCLGRIND LOG PROGRAM [ARGUMENT...]
#
# Every pattern of --gtest_filter has to choose a test: an entry that runs nothing proves nothing.
#
# Kernels are built without optimisation: every access of the source is then there to be checked, and
# the check for uninitialised memory knows all instructions (not so "freeze").
set -u
oclgrind=$1
log=$2
shift 2
for argument in "$@"; do
  case $argument in
  --gtest_filter=*)
    patterns=${argument#--gtest_filter=}
    set -f
    IFS=:
    for pattern in $patterns; do
      if ! "$1" --gtest_filter="$pattern" --gtest_list_tests | grep -q '^  '; then
        echo "run_oclgrind: $1 has no test $pattern" >&2
        exit 1
      fi
    done
    set +f
    unset IFS
    ;;
  esac
done
rm -f "$log"
"$oclgrind" --build-options -O0 --data-races --uninitialized --log "$log" "$@"
status=$?
if [ "$status" -ne 0 ]; then
  echo "run_oclgrind: $1 ended with status $status" >&2
  exit "$status"
fi
if [ -s "$log" ]; then
  echo "run_oclgrind: reports of the simulator:" >&2
  head -n 100 "$log" >&2
  exit 1
fi
