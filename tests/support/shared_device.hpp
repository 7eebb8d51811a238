// One device for all tests of a program, so that its kernels are built once.
#pragma once

#include "weft/device/device.hpp"

namespace weft::test {

// The device "auto", made on first use. After the last test it is released, and the program fails
// unless every OpenCL object of ours is gone with it.
Device& shared_device();

}  // namespace weft::test
