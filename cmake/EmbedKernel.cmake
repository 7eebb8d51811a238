# Writes one OpenCL C file as a C++ string: -DINPUT=file.cl -DOUTPUT=file.cpp -DSTEM=file
#
# A line `#include "other.cl"` is replaced by that file, between #line directives, so that a compile
# error names the file and the line that a person wrote.
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/TextBytes.cmake)

get_filename_component(folder ${INPUT} DIRECTORY)
file(READ ${INPUT} rest)
set(text "#line 1 \"${STEM}.cl\"\n")
set(line 1)
while(TRUE)
  string(FIND "${rest}" "#include \"" at)
  if(at EQUAL -1)
    break()
  endif()
  string(SUBSTRING "${rest}" 0 ${at} before)
  string(SUBSTRING "${rest}" ${at} -1 rest)
  string(FIND "${rest}" "\n" end)
  string(SUBSTRING "${rest}" 0 ${end} directive)
  string(SUBSTRING "${rest}" ${end} -1 rest)
  string(REGEX REPLACE "^#include \"([a-z0-9_]+\\.cl)\".*" "\\1" name "${directive}")
  string(REGEX MATCHALL "\n" newlines "${before}")
  list(LENGTH newlines count)
  math(EXPR line "${line} + ${count}")
  math(EXPR next "${line} + 1")
  file(READ ${folder}/${name} included)
  string(APPEND text "${before}#line 1 \"${name}\"\n${included}#line ${next} \"${STEM}.cl\"")
endwhile()
string(APPEND text "${rest}")

weft_text_bytes("${text}" bytes length)
file(WRITE ${OUTPUT} "// Made from ${STEM}.cl by EmbedKernel.cmake.
#include \"weft/device/kernel_sources.hpp\"

namespace weft::kernel_sources {
namespace {
const unsigned char bytes[${length} + 1] = {${bytes}0};
}
const KernelSource ${STEM}{\"${STEM}.cl\", reinterpret_cast<const char*>(bytes)};
}  // namespace weft::kernel_sources
")
