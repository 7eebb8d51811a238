#!/bin/sh
# Installs what Weft needs from Debian 12, and says what that is.
#
#   sh tools/setup.sh            packages to build and run the program
#   sh tools/setup.sh --tests    also those of the tests and of the style checks
#   sh tools/setup.sh --peers    also what tools/peers compares with; TensorLy and, where there is a wheel of
#                                it, SPAMS, which Debian does not have, by pip
#   sh tools/setup.sh --check    (with or without the others) only says what is missing; status 1 if
#                                anything is
#
# Uses sudo when not run as root. Asks nothing.
set -eu

build_packages="
  g++ cmake ninja-build
  libeigen3-dev libfmt-dev nlohmann-json3-dev libcli11-dev
  libopenexr-dev libjpeg62-turbo-dev libpng-dev libzip-dev libxxhash-dev libzstd-dev
  libembree-dev
  ocl-icd-opencl-dev pocl-opencl-icd"
test_packages="
  libgtest-dev python3 python3-numpy oclgrind clang-format clang-tidy
  chromium chromium-driver python3-selenium"

peer_packages="
  libopenblas-pthread-dev libclblast-dev python3-sklearn python3-scipy python3-pip"
peer_modules="tensorly"
# MODULE=PACKAGE of pip; comparisons do without
optional_modules="spams=spams-bin"

check=no
packages=$build_packages
modules=
optional=
for argument in "$@"; do
  case $argument in
    --check) check=yes ;;
    --tests) packages="$packages $test_packages" ;;
    --peers)
      packages="$packages $peer_packages"
      modules=$peer_modules
      optional=$optional_modules
      ;;
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

missing_modules=
for module in $modules; do
  /usr/bin/python3 -c "import $module" 2>/dev/null || missing_modules="$missing_modules $module"
done

missing_optional=
for module in $optional; do
  /usr/bin/python3 -c "import ${module%=*}" 2>/dev/null ||
    missing_optional="$missing_optional ${module#*=}"
done

if [ -z "$missing$missing_modules$missing_optional" ]; then
  echo "setup: all packages are there"
  exit 0
fi
[ -z "$missing" ] || echo "setup: missing packages:$missing"
[ -z "$missing_modules" ] || echo "setup: missing Python modules:$missing_modules"
[ -z "$missing_optional" ] || echo "setup: missing Python packages that are optional:$missing_optional"
if [ "$check" = yes ]; then
  [ -z "$missing$missing_modules" ] || exit 1
  exit 0
fi

if [ -n "$missing" ]; then
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
fi
if [ -n "$missing_modules" ]; then
  # beside Debian's own NumPy and SciPy, for this user alone
  echo "setup: installing them with pip"
  /usr/bin/python3 -m pip install -q --user --break-system-packages $missing_modules
fi
for package in $missing_optional; do
  /usr/bin/python3 -m pip install -q --user --break-system-packages "$package" ||
    echo "setup: $package can't be installed here; comparisons leave it out" >&2
done
