# Writes the shipped tuning database as a C++ string: -DINPUT=tuning.json -DOUTPUT=tuning.cpp
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/TextBytes.cmake)

file(READ ${INPUT} text)
weft_text_bytes("${text}" bytes length)
file(WRITE ${OUTPUT} "// Made from tuning.json by EmbedTuning.cmake.
#include \"weft/device/kernel_sources.hpp\"

namespace weft {
namespace {
const unsigned char bytes[${length} + 1] = {${bytes}0};
}
const char* const shipped_tuning_text = reinterpret_cast<const char*>(bytes);
}  // namespace weft
")
