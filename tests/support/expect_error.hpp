// Expects a weft::Error whose message names what it should:
//
//   expect_error(ErrorKind::input, {"file.weft", "codec"}, [&] { ModelFile file(path); });
#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <string>
#include <string_view>

#include "weft/error.hpp"

namespace weft::test {

template <typename Action>
void expect_error(ErrorKind kind, std::initializer_list<std::string_view> parts,
                  const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    const std::string message = error.what();
    EXPECT_EQ(static_cast<int>(error.kind()), static_cast<int>(kind)) << message;
    for (const std::string_view part : parts) {
      EXPECT_NE(message.find(part), std::string::npos)
          << "\"" << message << "\" does not name \"" << part << "\"";
    }
    return;
  }
  ADD_FAILURE() << "no error; expected one that names \""
                << (parts.size() > 0 ? *parts.begin() : std::string_view()) << "\"";
}

}  // namespace weft::test
