// Model files whose bytes are changed under right checksums: an error that says so, or a model that
// can be decoded.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <filesystem>

#include "io/file_bytes.hpp"
#include "model/edit_model.hpp"
#include "support/mutate.hpp"
#include "weft/error.hpp"

namespace weft::test {

// Damages the file `times` times; `open` reads it and decodes what it got. Returns how often that
// was possible.
template <typename Open>
std::size_t damage_and_open(const std::filesystem::path& path, int times, Random& random,
                            const Open& open) {
  const EditableModel good(read_bytes(path));
  std::size_t opened = 0;
  for (int i = 0; i < times; ++i) {
    EditableModel edited = good;
    const std::size_t size = edited.data.size();
    edited.data = mutate(edited.data, size, random);
    edited.data.resize(size);
    edited.set_checksums();
    write_bytes(path, edited.file());
    try {
      open();
      ++opened;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::input) << error.what();
    }
  }
  return opened;
}

}  // namespace weft::test
