// Look-ups in raw images and their mip levels on the device, against sums of what was stored.
#include "weft/ops/look_up_raw.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "weft/codecs/look_up.hpp"
#include "weft/reference/lookup.hpp"
#include "weft/render/raw_sampler.hpp"
#include "weft/scene/shader.hpp"

namespace weft::test {
namespace {

std::vector<std::uint32_t> random_lookups(const LookupShape& lookup, const BtfShape& shape,
                                          std::size_t count) {
  Random random(7);
  std::vector<std::uint32_t> records;
  const auto add = [&](std::size_t taps, std::size_t limit) {
    for (std::size_t t = 0; t < taps; ++t) {
      records.push_back(static_cast<std::uint32_t>(random.index(limit)));
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    add(lookup.texels, shape.texels());
    add(lookup.views, shape.views);
    add(lookup.lights, shape.lights);
    for (std::size_t w = 0; w < lookup.weights(); ++w) {
      const double weight = random.index(5) == 0 ? 0.0 : random.uniform();
      records.push_back(std::bit_cast<std::uint32_t>(static_cast<float>(weight)));
    }
  }
  return records;
}

std::vector<float> look_up(DeviceSampler& sampler, const LookupShape& lookup, std::size_t channels,
                           std::span<const std::uint32_t> records) {
  GuardedBuffer lookups(shared_device(), records, "look-ups");
  const std::size_t count = records.size() / lookup.words();
  GuardedBuffer out(shared_device(), count * channels * sizeof(float), "values");
  sampler.look_up(lookup, count, lookups.buffer(), out.buffer());
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  return values;
}

std::shared_ptr<MemorySource> random_source(const BtfShape& shape, DType dtype, Encoding encoding,
                                            bool mapped = false) {
  BtfInfo info = make_info(shape, dtype);
  info.encoding = encoding;
  return std::make_shared<MemorySource>(
      info, encode_values(random_values(shape.values(), 3, 0.0, 1.0), dtype), mapped);
}

// All levels of a source against the reference's; with every level resident or none.
void expect_levels(const std::shared_ptr<MemorySource>& source, bool resident) {
  const BtfShape shape = source->info().shape;
  const std::size_t levels = mip_levels(shape);
  const auto images = source_images(shared_device(), source);
  const RawLevelsPlan plan =
      plan_raw_levels(shared_device(), *images, 0, levels, resident ? std::size_t{1} << 30 : 0);
  EXPECT_EQ(plan.first_resident, resident ? 0 : levels);
  const auto samplers = raw_samplers(shared_device(), images, 0, levels, plan);
  ASSERT_EQ(samplers.size(), levels);
  std::shared_ptr<TileSource> reference = source;
  const LookupShape lookup{4, 3, 3};
  for (std::size_t level = 0; level < levels; ++level) {
    const std::size_t count = is_simulator(shared_device()) ? 5 : 130;
    const auto records = random_lookups(lookup, reference->info().shape, count);
    std::vector<double> expected(count * shape.channels);
    reference::tile_sampler(*reference)->look_up(lookup, records, expected);
    // 36 values in [0, 1] of weight below 1 in sums of that length; a level's values are stored
    // again, at most half a step away, or one where the device rounds to the other side.
    const double step = source->info().dtype == DType::u8    ? 1.0 / 255
                        : source->info().dtype == DType::f16 ? 0x1p-11
                                                             : 0x1p-24;
    const double tolerance =
        36 * (gamma(46, float_roundoff) + static_cast<double>(level) * 2 * step);
    EXPECT_TRUE(all_near(look_up(*samplers[level], lookup, shape.channels, records), expected,
                         level == 0 ? 36 * gamma(46, float_roundoff) : tolerance))
        << "level " << level;
    if (level + 1 < levels) reference = next_mip_level(reference);
  }
}

TEST(LookUpRaw, OfEachType) {
  expect_levels(random_source({3, 4, 5, 6, 3}, DType::u8, Encoding::srgb), true);
  expect_levels(random_source({3, 4, 5, 6, 3}, DType::f16, Encoding::linear), true);
  expect_levels(random_source({3, 4, 3, 2, 1}, DType::f32, Encoding::gamma22), false);
}

TEST(LookUpRaw, EveryLevelIsThatOfTheReference) {
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    expect_levels(random_source({5, 7, 9, 16, 3}, dtype, Encoding::linear, true), true);
    expect_levels(random_source({5, 7, 9, 16, 3}, dtype, Encoding::linear, true), false);
  }
}

// Whatever the runs of images: streamed by mapped or read runs, or from memory.
TEST(LookUpRaw, RunsGiveTheSameBits) {
  const BtfShape shape{13, 17, 6, 5, 3};
  const LookupShape lookup{4, 3, 3};
  const auto records = random_lookups(lookup, shape, 200);
  std::vector<std::vector<float>> results;
  for (const bool resident : {true, false}) {
    for (const bool mapped : {true, false}) {
      const auto images = source_images(shared_device(),
                                        random_source(shape, DType::f16, Encoding::linear, mapped));
      const RawLevelsPlan plan =
          plan_raw_levels(shared_device(), *images, 0, 1, resident ? std::size_t{1} << 30 : 0);
      const auto samplers = raw_samplers(shared_device(), images, 0, 1, plan);
      results.push_back(look_up(*samplers[0], lookup, 3, records));
    }
  }
  for (const auto& result : results) EXPECT_TRUE(all_equal(result, results[0]));
}

// One by one, images add what they have; the last of them and the first.
TEST(LookUpRaw, SmallSumOfSingleImages) {
  Device& device = shared_device();
  const BtfShape shape{2, 3, 2, 2, 3};
  const auto source = random_source(shape, DType::f32, Encoding::linear);
  const LookupShape lookup{1, 3, 3};
  const auto records = random_lookups(lookup, shape, 3);
  GuardedBuffer lookups(device, std::span<const std::uint32_t>(records), "look-ups");
  std::vector<std::vector<float>> sums;
  for (const std::size_t run : Sizes{1, 4, 6}) {
    GuardedBuffer out(device, std::span<const float>(std::vector<float>(9, 0.0f)), "values");
    for (std::size_t first = 0; first < 6; first += run) {
      const std::size_t count = std::min<std::size_t>(run, 6 - first);
      std::vector<std::byte> images(count * source->info().image_bytes());
      source->read(first, count, images);
      GuardedBuffer raw(device, std::span<const std::byte>(images), "images");
      ops::look_up_raw(device, {lookup, shape, 3, lookups.buffer(), out.buffer()}, DType::f32,
                       first, count, raw.buffer());
      sums.push_back(out.values<float>());
      EXPECT_TRUE(raw.intact());
    }
    EXPECT_TRUE(out.intact());
  }
  EXPECT_TRUE(all_equal(sums[5], sums.back()));
  EXPECT_TRUE(all_equal(sums[7], sums.back()));
}

// The taps of records [first, first + count) and their sums, against the reference. Values where a
// weight is zero are NaN: they are not looked at.
void expect_taps(const LookupShape& lookup, std::size_t channels, std::size_t first,
                 std::size_t count) {
  SCOPED_TRACE(testing::Message() << count << " look-ups of " << lookup.texels << " x "
                                  << lookup.views << " x " << lookup.lights << " from " << first);
  Device& device = shared_device();
  const BtfShape shape{5, 6, 7, 8, channels};
  const auto records = random_lookups(lookup, shape, first + count);
  const auto part = std::span<const std::uint32_t>(records).subspan(first * lookup.words());
  const std::size_t taps = ops::taps_of(lookup);
  GuardedBuffer lookups(device, std::span<const std::uint32_t>(records), "look-ups");
  GuardedBuffer expanded(device, count * taps * 3 * sizeof(std::uint32_t), "taps");
  ops::expand_taps(device, lookup, first, count, lookups.buffer(), expanded.buffer());
  EXPECT_EQ(expanded.values<std::uint32_t>(), reference::expand_taps(lookup, part));
  EXPECT_TRUE(expanded.intact());

  std::vector<float> values = random_floats(count * taps * channels, 5, -1, 1);
  for (std::size_t i = 0; i < count * taps; ++i) {
    const Lookup record(lookup, part.subspan(i / taps * lookup.words(), lookup.words()));
    const std::size_t t = i % lookup.texels, b = i / lookup.texels % lookup.lights;
    const std::size_t a = i / lookup.texels / lookup.lights % lookup.views;
    if (record.texel_weight(t) * record.view_weight(a) * record.light_weight(b) == 0) {
      values[i * channels] = std::numeric_limits<float>::quiet_NaN();
    }
  }
  std::vector<double> expected(count * channels);
  reference::sum_taps(lookup, part, channels, std::vector<double>(values.begin(), values.end()),
                      expected);
  GuardedBuffer found(device, std::span<const float>(values), "values of taps");
  const std::vector<float> before(first * channels, -1.0f);
  GuardedBuffer out(device, (first + count) * channels * sizeof(float), "values");
  if (first > 0) device.write(out.buffer(), std::span<const float>(before));
  ops::sum_taps(device, lookup, channels, first, count, lookups.buffer(), found.buffer(),
                out.buffer());
  const std::vector<float> all = out.values<float>();
  EXPECT_TRUE(all_equal(std::span(all).first(before.size()), before));
  // values in [-1, 1], weights below 1
  const auto terms = static_cast<double>(taps);
  EXPECT_TRUE(
      all_near(std::span(all).subspan(before.size()), expected,
               terms * gamma(static_cast<double>(lookup.texels + lookup.views * lookup.lights + 1),
                             float_roundoff)));
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(found.intact());
  EXPECT_TRUE(lookups.intact());
}

TEST(LookUpTaps, SmallOfEveryShape) {
  for (const std::size_t texels : Sizes{1, 4}) {
    for (const std::size_t views : Sizes{1, 3}) {
      for (const std::size_t lights : Sizes{1, 3}) expect_taps({texels, views, lights}, 3, 2, 3);
    }
  }
  expect_taps({4, 3, 3}, 1, 0, 1);
}

TEST(LookUpTaps, StraddlesBlocks) {
  for (const std::size_t count : Sizes{1, 63, 64, 65, 300}) {
    expect_taps({4, 3, 3}, 3, 0, count);
    expect_taps({1, 3, 1}, 4, 65, count);
    expect_taps({4, 1, 1}, 31, 3, count);
  }
}

// Averages of 2 x 2, of 2 x 1 in the last column and row; images before and after are left alone.
TEST(LookUpRaw, SmallMipLevel) {
  Device& device = shared_device();
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const auto source = random_source({1, 3, 3, 5, 2}, dtype, Encoding::srgb);
    GuardedBuffer in(device, std::span<const std::byte>(source->bytes()), "images");
    const std::vector<std::byte> before(4 * 2 * 3 * 2 * size_of(dtype), std::byte{1});
    GuardedBuffer out(device, std::span<const std::byte>(before), "levels");
    ops::reduce_mip(device, source->info(), 2, 1, in.buffer(), 2, out.buffer());
    EXPECT_TRUE(out.intact());
    const auto level = next_mip_level(source);
    std::vector<std::byte> expected(2 * level->info().image_bytes());
    level->read(1, 2, expected);
    const std::vector<std::byte> found = out.values<std::byte>();
    const std::vector<std::byte> images(
        found.begin() + static_cast<std::ptrdiff_t>(found.size() / 2), found.end());
    const double step = dtype == DType::u8    ? 1.0 / 255
                        : dtype == DType::f16 ? 0x1p-11
                                              : 64 * 0x1p-24;
    EXPECT_TRUE(all_near(decode_values(images, dtype), decode_values(expected, dtype), step));
    EXPECT_TRUE(std::equal(before.begin(),
                           before.begin() + static_cast<std::ptrdiff_t>(found.size() / 2),
                           found.begin()));
  }
}

TEST(LookUpRaw, NonFiniteValuesCountAsZero) {
  for (const DType dtype : {DType::f16, DType::f32}) {
    const BtfShape shape{1, 1, 1, 4, 1};
    const double infinity = std::numeric_limits<double>::infinity();
    const auto source = std::make_shared<MemorySource>(
        make_info(shape, dtype),
        encode_values(std::vector<double>{std::nan(""), infinity, -infinity, 0x1p-24}, dtype));
    const auto images = source_images(shared_device(), source);
    const auto plan = plan_raw_levels(shared_device(), *images, 0, 1, std::size_t{1} << 30);
    const auto samplers = raw_samplers(shared_device(), images, 0, 1, plan);
    const std::vector<std::uint32_t> records{0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
    EXPECT_TRUE(all_equal(look_up(*samplers[0], {1, 1, 1}, 1, records),
                          std::vector<float>{0, 0, 0, 0x1p-24f}));
  }
}

// A user's look-ups give the same bits in any order and in batches of any size.
TEST(Lookups, OrderAndMemoryChangeNothing) {
  const BtfShape shape{5, 6, 7, 8, 3};
  const LookupShape lookup{4, 3, 3};
  const auto source = random_source(shape, DType::f16, Encoding::linear);
  const auto images = source_images(shared_device(), source);
  const auto plan = plan_raw_levels(shared_device(), *images, 0, 1, std::size_t{1} << 30);
  const auto samplers = raw_samplers(shared_device(), images, 0, 1, plan);
  const auto records = random_lookups(lookup, shape, 301);
  const std::vector<float> expected = look_up(*samplers[0], lookup, 3, records);
  std::vector<float> out(expected.size());
  for (const LookupOrder order : {LookupOrder::as_given, LookupOrder::by_image}) {
    for (const std::size_t memory : {std::size_t{20000}, std::size_t{1} << 30}) {
      std::fill(out.begin(), out.end(), -1.0f);
      Job job;
      job.memory = memory;
      look_up(shared_device(), *samplers[0], shape, lookup, records, order, out, job);
      EXPECT_TRUE(all_equal(out, expected)) << memory;
    }
  }
  Job job;
  look_up(shared_device(), *samplers[0], shape, lookup, {}, LookupOrder::by_image, {}, job);
  expect_error(ErrorKind::input, {"301", "902"}, [&] {
    look_up(shared_device(), *samplers[0], shape, lookup, records, LookupOrder::as_given,
            std::span(out).first(902), job);
  });
  auto hostile = records;
  hostile[0] = 56;
  expect_error(ErrorKind::input, {"look-up 0", "texel 56"}, [&] {
    look_up(shared_device(), *samplers[0], shape, lookup, hostile, LookupOrder::as_given, out, job);
  });
}

TEST(Lookups, HostileOnesAreRefused) {
  const BtfShape shape{2, 3, 4, 5, 3};
  const LookupShape lookup{1, 3, 1};
  const std::uint32_t half = std::bit_cast<std::uint32_t>(0.5f);
  const std::vector<std::uint32_t> good{19, 0, 1, 1, 2, half, half, 0};
  EXPECT_NO_THROW(validate_lookups(lookup, shape, good));
  const auto with = [&](std::size_t word, std::uint32_t value) {
    std::vector<std::uint32_t> records = good;
    records.insert(records.end(), good.begin(), good.end());
    records[good.size() + word] = value;
    return records;
  };
  expect_error(ErrorKind::input, {"look-up 1", "texel 20", "20"},
               [&] { validate_lookups(lookup, shape, with(0, 20)); });
  expect_error(ErrorKind::input, {"look-up 1", "view 2"},
               [&] { validate_lookups(lookup, shape, with(3, 2)); });
  expect_error(ErrorKind::input, {"look-up 1", "light 4294967295", "3"},
               [&] { validate_lookups(lookup, shape, with(4, 0xffffffff)); });
  expect_error(ErrorKind::input, {"look-up 1", "weight"},
               [&] { validate_lookups(lookup, shape, with(6, 0x7fc00000)); });
  expect_error(ErrorKind::input, {"7 words", "8"},
               [&] { validate_lookups(lookup, shape, std::span(good).first(7)); });
  expect_error(ErrorKind::input, {"2 texels"}, [&] { validate({2, 1, 1}, shape); });
  expect_error(ErrorKind::input, {"32 bits"}, [&] {
    validate({1, 1, 1}, {1, 1, std::size_t{1} << 20, 1 << 20, 1});
  });
}

}  // namespace
}  // namespace weft::test
