# Writes the presets of materials as C++ strings: -DFOLDER=presets -DNAMES=a,b,... -DOUTPUT=file.cpp
cmake_minimum_required(VERSION 3.25)
include(${CMAKE_CURRENT_LIST_DIR}/TextBytes.cmake)

string(REPLACE "," ";" names "${NAMES}")
set(texts "")
set(table "")
foreach(name IN LISTS names)
  file(READ ${FOLDER}/${name}.json text)
  weft_text_bytes("${text}" bytes length)
  string(APPEND texts "const unsigned char ${name}_text[${length} + 1] = {${bytes}0};\n")
  string(APPEND table "    {\"${name}\", reinterpret_cast<const char*>(${name}_text)},\n")
endforeach()
file(WRITE ${OUTPUT} "// Made from presets/*.json by EmbedPresets.cmake.
#include <array>

#include \"weft/scene/material.hpp\"

namespace weft {
namespace {
${texts}}  // namespace

std::span<const MaterialPreset> material_presets() {
  static const auto presets = std::to_array<MaterialPreset>({
${table}  });
  return presets;
}

}  // namespace weft
")
