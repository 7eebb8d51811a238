#!/bin/sh
# Installs what Weft needs from Debian 12, and says what that is.
#
#   sh tools/setup.sh            packages to build and run the program
#   sh tools/setup.sh --tests    also those of the tests and of the style checks
#   sh tools/setup.sh --peers    also the libraries that tools/peers compares with
#   sh tools/setup.sh --check    (with or without the others) only says what is missing; status 1 if
#                                anything is
#
# Uses sudo when not run as root. Asks nothing.
set -eu

build_packages="
  g++ cmake ninja-build
  libeigen3-dev libfmt-dev nlohmann-json3-dev libcli11-dev
  libopenexr-dev libjpeg62-turbo-dev libpng-dev libzip-dev libxxhash-dev
  libembree-dev
  ocl-icd-opencl-dev pocl-opencl-icd"
test_packages="
  libgtest-dev python3 python3-numpy oclgrind clang-format clang-tidy"

peer_packages="
  libopenblas-pthread-dev libclblast-dev python3-sklearn"

check=no
packages=$build_packages
for argument in "$@"; do
  case $argument in
    --check) check=yes ;;
    --tests) packages="$packages $test_packages" ;;
    --peers) packages="$packages $peer_packages" ;;
    *)
      echo "usage: sh tools/setup.sh [--check] [--tests] [--peers]" >&2
      exit 2
      ;;
  esac
done

if ! command -v dpkg-query >/dev/null 2>&1; then
  echo "setup: this is no Debian system; install by your system's names:" $packages >&2
  [ "$check" = yes ] && exit 1
  # What is really missing, the build will say.
  exit 0
fi

missing=
for package in $packages; do
  status=$(dpkg-query -W -f '${Status}' "$package" 2>/dev/null || true)
  [ "$status" = "install ok installed" ] || missing="$missing $package"
done

if [ -z "$missing" ]; then
  echo "setup: all packages are there"
  exit 0
fi
echo "setup: missing packages:$missing"
[ "$check" = yes ] && exit 1

as_root=
if [ "$(id -u)" -ne 0 ]; then
  if ! command -v sudo >/dev/null 2>&1; then
    echo "setup: neither root nor sudo; run as root: apt-get install$missing" >&2
    exit 1
  fi
  as_root=sudo
fi
echo "setup: installing them with apt-get"
# An outdated list of packages may still do: the installation decides.
$as_root env DEBIAN_FRONTEND=noninteractive apt-get update -q </dev/null ||
  echo "setup: the list of packages could not be renewed" >&2
$as_root env DEBIAN_FRONTEND=noninteractive \
  apt-get install -q -y --no-install-recommends $missing </dev/null
