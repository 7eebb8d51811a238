# Writes text files as C++ string views: -DNAMES=a,b,... -DFILES=a.txt,b1.txt|b2.txt,... (files joined by
# | follow each other in one text) -DNAMESPACE=weft::x -DHEADER=x.hpp -DOUTPUT=file.cpp
cmake_minimum_required(VERSION 3.25)

string(REPLACE "," ";" names "${NAMES}")
string(REPLACE "," ";" groups "${FILES}")
set(bytes_of_all "")
set(views "")
foreach(name group IN ZIP_LISTS names groups)
  string(REPLACE "|" ";" files "${group}")
  # As digits, since a list would lose what CMake gives a meaning to.
  set(bytes "")
  set(length 0)
  foreach(file IN LISTS files)
    file(READ ${file} digits HEX)
    string(LENGTH "${digits}" count)
    math(EXPR length "${length} + ${count} / 2")
    string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," file_bytes "${digits}")
    string(APPEND bytes "${file_bytes}")
  endforeach()
  string(APPEND bytes_of_all "const unsigned char ${name}_bytes[${length} + 1] = {${bytes}0};\n")
  string(APPEND views
         "const std::string_view ${name}{reinterpret_cast<const char*>(${name}_bytes), ${length}};\n")
endforeach()
file(WRITE ${OUTPUT} "// Made by EmbedTexts.cmake.
#include \"${HEADER}\"

namespace ${NAMESPACE} {
namespace {
${bytes_of_all}}  // namespace
${views}}  // namespace ${NAMESPACE}
")
