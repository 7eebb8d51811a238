// Floats in memory and in files: the same to whoever reads them, through copies, cuts and releases.
#include "weft/tensor/float_store.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <string>
#include <utility>

#include "support/expect_error.hpp"

namespace weft::test {
namespace {

using Place = FloatStore::Place;

TEST(FloatStore, HoldsValuesInEitherPlace) {
  for (const Place place : {Place::memory, Place::file}) {
    for (const std::size_t count : {1U, 1023U, 1024U, 1025U, 100000U}) {
      FloatStore store(count, place);
      EXPECT_EQ(store.size(), count);
      EXPECT_EQ(std::count(store.begin(), store.end(), 0.0f), static_cast<std::ptrdiff_t>(count));
      std::iota(store.begin(), store.end(), 1.0f);
      store.release();
      const FloatStore copy = store;
      EXPECT_EQ(copy.place(), place);
      EXPECT_EQ(copy, store);
      store.shrink(count / 2);
      store.release();
      EXPECT_EQ(store.size(), count / 2);
      for (std::size_t i = 0; i < store.size(); ++i) {
        ASSERT_EQ(store[i], static_cast<float>(i + 1));
      }
      EXPECT_NE(copy, store);
      const FloatStore moved = std::move(store);
      EXPECT_EQ(moved.size(), count / 2);
    }
    EXPECT_TRUE(FloatStore(0, place).empty());
  }
  EXPECT_EQ(FloatStore(std::vector<float>{1, 2})[1], 2.0f);
}

TEST(FloatStore, NamesTheFolderThatHasNoRoom) {
  const char* before = std::getenv("TMPDIR");
  const std::string kept = before != nullptr ? before : "";
  // a folder that takes no files
  ASSERT_EQ(setenv("TMPDIR", "/proc", 1), 0);
  expect_error(ErrorKind::runtime, {"/proc", "temporary file"},
               [] { FloatStore(10, Place::file); });
  before != nullptr ? setenv("TMPDIR", kept.c_str(), 1) : unsetenv("TMPDIR");
}

}  // namespace
}  // namespace weft::test
