# Writes one OpenCL C file as a C++ string: -DINPUT=file.cl -DOUTPUT=file.cpp -DSTEM=file
file(READ ${INPUT} text HEX)
string(LENGTH "${text}" digits)
string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${text}")
string(REGEX REPLACE "(0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,0x..,)" "\\1\n    "
       bytes "${bytes}")
math(EXPR length "${digits} / 2")
file(WRITE ${OUTPUT} "// Made from ${STEM}.cl by EmbedKernel.cmake.
#include \"weft/device/kernel_sources.hpp\"

namespace weft::kernel_sources {
namespace {
const unsigned char bytes[${length} + 1] = {
    ${bytes}0};
}
const KernelSource ${STEM}{\"${STEM}.cl\", reinterpret_cast<const char*>(bytes)};
}  // namespace weft::kernel_sources
")
