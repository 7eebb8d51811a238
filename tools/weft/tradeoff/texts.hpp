// Files of this folder that are part of the program, made by EmbedTexts.cmake.
#pragma once

#include <string_view>

namespace weft::tradeoff_texts {

extern const std::string_view grid;    // grid.json, the default points
extern const std::string_view page;    // page.html, with places for the others
extern const std::string_view style;   // page.css
extern const std::string_view script;  // page/*.js, one after the other

}  // namespace weft::tradeoff_texts
