// Quantisation: its bound, its extremes, and the way back to codes.
#include "weft/model/quantise.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "model/small_pca.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "weft/model/storage.hpp"

namespace weft {
namespace {

using test::all_equal;
using test::expect_error;
using test::random_floats;

constexpr float largest_float = std::numeric_limits<float>::max();
constexpr float least_float = std::numeric_limits<float>::denorm_min();

Quantisation by_peaks(std::span<const float> values, const ComponentLayout& layout, unsigned bits) {
  return {bits, steps_of_bits(component_peaks(values, layout), bits)};
}

// Largest |value - quantised| / step over all components, where a step of 0 allows nothing.
void expect_within_half_a_step(std::vector<float> values, const ComponentLayout& layout,
                               unsigned bits) {
  const Quantisation quantisation = by_peaks(values, layout, bits);
  std::vector<float> quantised = values;
  quantise(quantised, layout, quantisation);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t component = i / layout.inner % layout.components;
    const double step = quantisation.steps[component];
    ASSERT_LE(std::abs(double{values[i]} - double{quantised[i]}), step / 2)
        << "index " << i << ", " << bits << " bits";
  }
  // what is quantised stays, and comes back from its codes
  std::vector<float> again = quantised;
  quantise(again, layout, quantisation);
  EXPECT_TRUE(all_equal(again, quantised));
  const std::vector<std::int32_t> codes = codes_of(quantised, layout, quantisation, "test");
  for (const std::int32_t code : codes) ASSERT_LE(std::abs(code), largest_code(bits));
  EXPECT_TRUE(all_equal(values_of(codes, layout, quantisation.steps), quantised));
}

TEST(Quantise, ErrorsAreAtMostHalfAStep) {
  for (const ComponentLayout& layout :
       {ComponentLayout{1, 1, 1}, ComponentLayout{1, 1, 1000}, ComponentLayout{7, 5, 3},
        ComponentLayout{200, 4, 1}, ComponentLayout{1, 30, 11}}) {
    const std::size_t count = layout.outer * layout.components * layout.inner;
    for (unsigned bits = least_bits; bits <= most_bits; ++bits) {
      for (const double magnitude : {1.0, 1e30, 1e-30, 3.3e38, 1e-38, 1e-42}) {
        expect_within_half_a_step(random_floats(count, bits, -magnitude, magnitude), layout, bits);
      }
    }
  }
}

TEST(Quantise, StepsHoldTheLargestValueAndNoMuchMore) {
  for (unsigned bits = least_bits; bits <= most_bits; ++bits) {
    for (const float peak : {1.0f, 0.3f, 1e30f, 1e-30f, largest_float}) {
      const float step = steps_of_bits(std::vector<float>{peak}, bits)[0];
      const double exact = double{peak} / largest_code(bits);
      EXPECT_GE(double{step}, exact);
      EXPECT_LE(double{step}, exact * (1 + 0x1p-8));  // 9 significant bits
    }
  }
  EXPECT_EQ(step_at_least(0), 0.0f);
  EXPECT_EQ(step_at_least(1.0), 1.0f);
  EXPECT_EQ(step_at_least(1.0 + 0x1p-20), 1.0f + 0x1p-8f);
  EXPECT_EQ(step_at_least(0x1p-160), least_float);
}

TEST(Quantise, Extremes) {
  for (unsigned bits = least_bits; bits <= most_bits; ++bits) {
    const auto kept = [&](const std::vector<float>& values, const ComponentLayout& layout) {
      std::vector<float> quantised = values;
      quantise(quantised, layout, by_peaks(values, layout, bits));
      return quantised;
    };
    // zeros beside others, of either sign
    EXPECT_EQ(kept({0, 1, -0.0f, -1}, {2, 2, 1})[0], 0.0f);
    EXPECT_FALSE(std::signbit(kept({0, 1, -0.0f, -1}, {2, 2, 1})[2]));
    EXPECT_EQ(kept({0, 0, 0}, {1, 1, 3}), (std::vector<float>{0, 0, 0}));
    // whole numbers as many as there are codes are exact
    const auto largest = static_cast<float>(largest_code(bits));
    EXPECT_EQ(kept({largest, 1, -largest, 3}, {1, 1, 4}),
              (std::vector<float>{largest, 1, -largest, 3}));
    EXPECT_EQ(kept({least_float, -least_float}, {1, 1, 2}),
              (std::vector<float>{least_float, -least_float}));
    for (const float value : kept({largest_float, -largest_float}, {1, 1, 2})) {
      EXPECT_TRUE(std::isfinite(value));
    }
    EXPECT_TRUE(kept({}, {1, 0, 4}).empty());
  }
}

TEST(Quantise, BitsAreTheFewestThatHoldTheCodes) {
  const std::vector<float> peaks{0, 100, 7};
  EXPECT_EQ(bits_of_steps(peaks, std::vector<float>{0, 100, 1}), 4u);
  EXPECT_EQ(bits_of_steps(peaks, std::vector<float>{0, 100, 0.5f}), 5u);
  EXPECT_EQ(bits_of_steps(peaks, std::vector<float>{0, 1, 1}), 8u);
  EXPECT_EQ(bits_of_steps(peaks, std::vector<float>{0, 0x1p-30f, 1}), 16u);
}

TEST(Quantise, ValuesThatAreNoMultiplesAreNamed) {
  const Quantisation quantisation{4, {0.5f, 0}};
  expect_error(ErrorKind::runtime, {"tensor", "index 2", "0.75"}, [&] {
    codes_of(std::vector<float>{0.5f, 0, 0.75f, 0}, {2, 2, 1}, quantisation, "tensor");
  });
  expect_error(ErrorKind::runtime, {"tensor", "index 1"}, [&] {
    codes_of(std::vector<float>{0.5f, 1, 1, 0}, {2, 2, 1}, quantisation, "tensor");
  });
  expect_error(ErrorKind::runtime, {"index 0", "4 bits"}, [&] {
    codes_of(std::vector<float>{4, 0}, {1, 2, 1}, quantisation, "tensor");
  });
  expect_error(ErrorKind::runtime, {"2 steps for 3 components"}, [&] {
    codes_of(std::vector<float>{1, 2, 3}, {1, 3, 1}, quantisation, "tensor");
  });
}

TEST(Quantise, MoreBitsNeverErrMore) {
  const ComponentLayout layout{50, 6, 7};
  const std::vector<float> values = random_floats(50 * 6 * 7, 9, -2, 2);
  double before = std::numeric_limits<double>::infinity();
  for (unsigned bits = least_bits; bits <= most_bits; ++bits) {
    std::vector<float> quantised = values;
    quantise(quantised, layout, by_peaks(values, layout, bits));
    double squares = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      squares += std::pow(double{values[i]} - double{quantised[i]}, 2);
    }
    EXPECT_LT(squares, before) << bits << " bits";
    before = squares;
  }
}

TEST(StorageRequest, IsReadFromItsText) {
  using Kind = StorageRequest::Kind;
  EXPECT_EQ(storage_request("f16").kind, Kind::half);
  EXPECT_EQ(storage_request("f16").fitted(), Storage::f16);
  EXPECT_EQ(storage_request("f32").kind, Kind::single);
  EXPECT_EQ(storage_request("q=4").bits, 4u);
  EXPECT_EQ(storage_request("q=16").bits, 16u);
  EXPECT_EQ(storage_request("q=16").fitted(), Storage::f32);
  EXPECT_EQ(storage_request("auto").kind, Kind::automatic);
  EXPECT_EQ(storage_request("auto").slack, 0.01);
  EXPECT_EQ(storage_request("auto=0.25").slack, 0.25);
  for (const char* text :
       {"", "f64", "F16", "q", "q=", "q=3", "q=17", "q=8.5", "q=8x", "q=-8", "automatic",
        "auto=", "auto=0", "auto=-1", "auto=2", "auto=nan", "auto=0.1x", "auto0.1"}) {
    SCOPED_TRACE(text);
    expect_error(ErrorKind::input, {"--storage", text}, [&] { storage_request(text); });
  }
}

TEST(StorageText, SaysTheBits) {
  PcaModel model = test::small_pca(Storage::f16);
  EXPECT_EQ(storage_text(model.info), "f16");
  quantise_all(model, 7);
  EXPECT_EQ(storage_text(model.info), "q=7");
  const std::vector<float> steps{0.25f, 0.001f};
  quantise_tensor(model, 1, steps);
  EXPECT_EQ(model.info.quantised.at("coefficients").bits, 11u);  // 1 / 0.001 < 1023
  EXPECT_EQ(storage_text(model.info), "q=7-11");
  set_storage(model, Storage::f32);
  EXPECT_EQ(storage_text(model.info), "f32");
}

}  // namespace
}  // namespace weft
