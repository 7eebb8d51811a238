// What holds for every codec under every colour transform, on the device and by the reference:
// models that survive their file, decoding in bulk, of single texels, of look-ups and of channels
// alike, and exact recovery of what a codec holds exactly.
#include <gtest/gtest.h>

#include <cmath>

#include "codecs/codec_runs.hpp"
#include "codecs/random_lookups.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/adapt.hpp"
#include "weft/btf/texel_block.hpp"
#include "weft/codecs/colour_source.hpp"
#include "weft/codecs/compress.hpp"

namespace weft::test {
namespace {

using Kind = ColourTransform::Kind;
constexpr Kind all_kinds[] = {Kind::none, Kind::log, Kind::ycrcb, Kind::logluv, Kind::decorrelated};

class EveryTransform : public testing::TestWithParam<CodecRun> {
 protected:
  const CodecRun& run() const { return GetParam(); }

  // By the whole of compression; full rank with k = 1000.
  std::unique_ptr<Model> compressed(TileSource& source, Kind kind, std::size_t k,
                                    Storage storage = Storage::f32) const {
    Job job;
    CompressRequest request;
    request.codec = &run().get();
    request.parameters = {{"rank", std::to_string(k)}};
    if (run().codec == "vq") request.parameters = {{"threshold", k == 1000 ? "0" : "0.1"}};
    if (run().codec == "sparse") {
      request.parameters["atoms"] = "1024";
      request.parameters["iterations"] = "3";
    }
    request.storage.kind =
        storage == Storage::f16 ? StorageRequest::Kind::half : StorageRequest::Kind::single;
    request.colour = {kind, {1, 0.5, 2}};
    return compress(run().on_device ? &shared_device() : nullptr, source, request, job).model;
  }
};

INSTANTIATE_TEST_SUITE_P(Table, EveryTransform, testing::ValuesIn(every_run()),
                         [](const auto& info) {
                           std::string name =
                               info.param.codec + (info.param.on_device ? "_Device" : "_Reference");
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

// Values over four decades, as of highlights.
std::shared_ptr<MemorySource> bright_source(const BtfShape& shape) {
  std::vector<double> values = random_values(shape.values(), 5, -2, 2);
  for (double& value : values) value = std::pow(10.0, value);
  return source_of(shape, DType::f32, values);
}

TEST_P(EveryTransform, ModelsSurviveTheirFile) {
  const TemporaryFolder folder;
  const auto source = bright_source({3, 4, 6, 7, 3});
  for (const Kind kind : all_kinds) {
    const auto model = compressed(*source, kind, 3, Storage::f16);
    EXPECT_EQ(model->info.colour_transform.kind, kind);
    EXPECT_EQ(model->info.btf.dtype, DType::f32);
    write_model(folder / "m.weft", *model);
    const auto found = read_model(folder / "m.weft");
    EXPECT_EQ(found->info.colour_transform, model->info.colour_transform);
    EXPECT_TRUE(all_equal(run().decode(*found, 5), run().decode(*model, 5)));
  }
}

// |w t|_F of what a model of all of `source` was fitted to.
double fitted_norm(const ColourTransform& transform, const MemorySource& source) {
  std::vector<double> values = decode_values(source.bytes(), source.info().dtype);
  double square = 0;
  for (std::size_t i = 0; i < values.size(); i += 3) {
    transform.apply(std::span(values).subspan(i, 3));
    for (std::size_t c = 0; c < 3; ++c) square += values[i + c] * values[i + c];
  }
  return std::sqrt(square);
}

// A codec of full rank holds what it fits within 1e-5 of its norm, as EveryCodec.ExtremesOfShape
// asks of it, and the inverse makes of that what its bound says.
TEST_P(EveryTransform, FullRankComesBack) {
  const BtfShape shape{2, 3, 5, 6, 3};
  for (const auto& source : {bright_source(shape), random_source(shape, DType::u8, 5)}) {
    for (const Kind kind : all_kinds) {
      const auto model = compressed(*source, kind, 1000);
      EXPECT_EQ(model->info.btf.dtype, source->info().dtype);
      const ColourTransform& transform = model->info.colour_transform;
      EXPECT_LE(run().measure(*model, *source).max_difference,
                inverted_error(transform, 3, 1e-5 * fitted_norm(transform, *source)))
          << name_of(kind);
    }
  }
}

TEST_P(EveryTransform, OneTexelIsThatOfTheImageAndBothDecodersAgree) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const auto source = bright_source(shape);
  for (const Kind kind : all_kinds) {
    SCOPED_TRACE(name_of(kind));
    const auto model = compressed(*source, kind, 4, Storage::f16);
    const double tolerance = run().get().decode_tolerance(*model);
    const std::vector<double> whole = CodecRun{run().codec, false}.decode(*model, 5);
    EXPECT_TRUE(all_near(CodecRun{run().codec, true}.decode(*model, 5), whole, tolerance));
    std::vector<double> texel(3);
    for (std::size_t i = 0; i < shape.values(); i += 3) {
      const std::size_t p = i / 3 % shape.texels();
      const std::size_t image = i / shape.image_values();
      model->decode_texel(image / shape.lights, image % shape.lights, p / shape.width,
                          p % shape.width, texel);
      ASSERT_TRUE(all_near(texel, std::span(whole).subspan(i, 3), tolerance));
    }
  }
}

// Channels of a model are those of its images; where the transform mixes them, all are decoded.
TEST_P(EveryTransform, ChannelsAndPartsAreThoseOfTheWhole) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const auto source = bright_source(shape);
  Selection selection;
  selection.views = {{2, 0}};
  selection.channels = {{2, 0}};
  for (const Kind kind : all_kinds) {
    SCOPED_TRACE(name_of(kind));
    const auto model = compressed(*source, kind, 4, Storage::f16);
    const std::vector<double> whole = run().decode(*model, 12);
    const auto part = run().get().select(*model, selection);
    ASSERT_EQ(part->info.btf.shape, (BtfShape{2, 4, 5, 6, 2}));
    std::vector<double> expected;
    for (const std::size_t v : *selection.views) {
      for (std::size_t i = 0; i < shape.lights * shape.texels(); ++i) {
        for (const std::size_t c : *selection.channels) {
          expected.push_back(whole[(v * shape.lights * shape.texels() + i) * 3 + c]);
        }
      }
    }
    const double tolerance = run().get().decode_tolerance(*model);
    for (const std::size_t images : Sizes{8, 3}) {
      EXPECT_TRUE(all_near(run().decode(*part, images), expected, tolerance));
    }
    std::vector<double> texel(2);
    part->decode_texel(1, 2, 3, 4, texel);
    const std::size_t at = ((shape.lights + 2) * shape.texels() + 3 * shape.width + 4) * 2;
    EXPECT_TRUE(all_near(texel, std::span(expected).subspan(at, 2), tolerance));
    EXPECT_GE(run().get().decoder_bytes(*part), 1U);
    // and a part of the part
    Selection one;
    one.channels = {{1}};
    const auto last = run().get().select(*part, one);
    std::vector<double> second;
    for (std::size_t i = 1; i < expected.size(); i += 2) second.push_back(expected[i]);
    EXPECT_TRUE(all_near(run().decode(*last, 8), second, tolerance));
    one.channels = {{2}};
    expect_error(ErrorKind::input, {"2"}, [&] { run().get().select(*part, one); });
  }
}

// Look-ups interpolate what the model decodes to, whatever the transform.
TEST_P(EveryTransform, LookupsInterpolateDecodedTexels) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const LookupShape lookup{4, 3, 3};
  const std::size_t count = 65;
  const auto source = bright_source(shape);
  Random random(11);
  const std::vector<std::uint32_t> records = random_lookups(lookup, shape, count, random);
  for (const Kind kind : all_kinds) {
    SCOPED_TRACE(name_of(kind));
    const auto model = compressed(*source, kind, 4, Storage::f16);
    std::vector<double> expected(count * 3, 0.0), texel(3);
    for (std::size_t i = 0; i < count; ++i) {
      const Lookup taps(lookup, std::span(records).subspan(i * lookup.words(), lookup.words()));
      for (std::size_t n = 0; n < 36; ++n) {
        const std::size_t t = n % 4, v = n / 4 % 3, l = n / 12;
        model->decode_texel(taps.views[v], taps.lights[l], taps.texels[t] / shape.width,
                            taps.texels[t] % shape.width, texel);
        const double weight = taps.texel_weight(t) * taps.view_weight(v) * taps.light_weight(l);
        for (std::size_t c = 0; c < 3; ++c) expected[i * 3 + c] += weight * texel[c];
      }
    }
    const double tolerance = lookup_tolerance(run().get(), *model, lookup);
    std::vector<double> by_reference(count * 3);
    run().get().reference_sampler(*model)->look_up(lookup, records, by_reference);
    EXPECT_TRUE(all_near(by_reference, expected, tolerance));
    GuardedBuffer lookups(shared_device(), std::span<const std::uint32_t>(records), "look-ups");
    GuardedBuffer out(shared_device(), count * 3 * sizeof(float), "values");
    run()
        .get()
        .sampler(shared_device(), *model)
        ->look_up(lookup, count, lookups.buffer(), out.buffer());
    EXPECT_TRUE(all_near(out.values<float>(), expected, tolerance));
    EXPECT_TRUE(out.intact());

    Selection blue;
    blue.channels = {{2}};
    const auto part = run().get().select(*model, blue);
    std::vector<double> blues;
    for (std::size_t i = 2; i < expected.size(); i += 3) blues.push_back(expected[i]);
    GuardedBuffer one(shared_device(), count * sizeof(float), "values");
    run()
        .get()
        .sampler(shared_device(), *part)
        ->look_up(lookup, count, lookups.buffer(), one.buffer());
    EXPECT_TRUE(all_near(one.values<float>(), blues, tolerance));
    EXPECT_TRUE(one.intact());
  }
}

// More look-ups than a sampler takes the taps of at a time, and the memory that it plans for.
TEST_P(EveryTransform, LookupsOfManyChunksGiveTheSameBits) {
  if (!run().on_device) return;  // the sampler is the same
  Device& device = shared_device();
  const BtfShape shape{3, 4, 5, 6, 3};
  const LookupShape lookup{4, 3, 3};
  const std::size_t count = 6000, last = 1201, plain = 65;
  const auto source = bright_source(shape);
  Random random(12);
  const std::vector<std::uint32_t> records = random_lookups(lookup, shape, count, random);
  const std::vector<std::uint32_t> singles = random_lookups({1, 1, 1}, shape, plain, random);
  for (const Kind kind : {Kind::log, Kind::logluv}) {
    SCOPED_TRACE(name_of(kind));
    const auto model = compressed(*source, kind, 4, Storage::f16);
    const std::size_t before = device.allocated();
    const auto sampler = run().get().sampler(device, *model);
    EXPECT_LE(device.allocated() - before, run().get().sampler_bytes(*model));
    const auto found = [&](const LookupShape& of, std::span<const std::uint32_t> some) {
      const std::size_t n = some.size() / of.words();
      GuardedBuffer lookups(device, some, "look-ups");
      GuardedBuffer out(device, n * 3 * sizeof(float), "values");
      sampler->look_up(of, n, lookups.buffer(), out.buffer());
      EXPECT_TRUE(out.intact());
      return out.values<float>();
    };
    const std::vector<float> whole = found(lookup, records);
    EXPECT_TRUE(all_equal(found(lookup, std::span(records).last(last * lookup.words())),
                          std::span(whole).last(last * 3)));
    // plain ones are texels
    std::vector<double> texels(plain * 3);
    for (std::size_t i = 0; i < plain; ++i) {
      const std::size_t p = singles[3 * i];
      model->decode_texel(singles[3 * i + 1], singles[3 * i + 2], p / shape.width, p % shape.width,
                          std::span(texels).subspan(3 * i, 3));
    }
    EXPECT_TRUE(all_near(found({1, 1, 1}, singles), texels,
                         lookup_tolerance(run().get(), *model, {1, 1, 1})));
  }
}

// Averages commute with linear transforms alone.
TEST_P(EveryTransform, MipLevelsOfModelsNeedLinearTransforms) {
  const auto linear = relabelled(bright_source({2, 3, 4, 4, 3}), Encoding::linear, std::nullopt);
  const bool has_levels =
      run().get().next_mip_level(*compressed(*linear, Kind::none, 3)) != nullptr;
  for (const Kind kind : all_kinds) {
    const auto next = run().get().next_mip_level(*compressed(*linear, kind, 3));
    const bool nonlinear = kind == Kind::log || kind == Kind::logluv;
    EXPECT_EQ(next != nullptr, has_levels && !nonlinear) << name_of(kind);
    if (next) {
      EXPECT_EQ(next->info.colour_transform.kind, kind);
    }
  }
}

// The transform's numbers follow the data, whatever their magnitude.
TEST(ColourSource, ChoosesItsNumbersByTheData) {
  const BtfShape shape{2, 2, 3, 3, 3};
  for (const double magnitude : {1.0, 65504.0, 1e30, 1e-30}) {
    std::vector<double> values = random_values(shape.values(), 3, -1, 1);
    double sum = 0, largest = 0;
    for (double& value : values) {
      value = static_cast<double>(static_cast<float>(value * magnitude));
      sum += std::abs(value);
      largest = std::max(largest, std::abs(value));
    }
    const auto source = source_of(shape, DType::f32, values);
    Job job;
    const ColourTransform log = choose_colour_transform(*source, {Kind::log, {}}, job);
    EXPECT_NEAR(log.scale, sum / static_cast<double>(values.size()), 1e-12 * log.scale);
    EXPECT_EQ(log.largest, largest);
    // axes: decorrelated channels, the first of the largest variance
    const ColourTransform axes = choose_colour_transform(*source, {Kind::decorrelated, {}}, job);
    std::vector<double> means(3), variances(9);
    const double texels = static_cast<double>(values.size() / 3);
    for (std::size_t i = 0; i < values.size(); i += 3) {
      axes.apply(std::span(values).subspan(i, 3));
      for (std::size_t c = 0; c < 3; ++c) means[c] += values[i + c] / texels;
    }
    for (std::size_t i = 0; i < values.size(); i += 3) {
      for (std::size_t n = 0; n < 9; ++n) {
        variances[n] += (values[i + n / 3] - means[n / 3]) * (values[i + n % 3] - means[n % 3]);
      }
    }
    EXPECT_GE(variances[0], variances[4]);
    EXPECT_GE(variances[4], variances[8]);
    for (const std::size_t n : Sizes{1, 2, 5})
      EXPECT_LE(std::abs(variances[n]), 1e-12 * variances[0]);
  }
}

TEST(ColourSource, BlackDataAndOneChannel) {
  Job job;
  const auto black = source_of({1, 1, 2, 2, 3}, DType::f32, std::vector<double>(12, 0.0));
  for (const Kind kind : all_kinds) {
    const ColourTransform transform = choose_colour_transform(*black, {kind, {}}, job);
    TransformedSource source(*black, transform, false);
    std::vector<std::byte> bytes(48, std::byte{1});
    source.read(0, 1, bytes);
    EXPECT_EQ(bytes, std::vector<std::byte>(48, std::byte{0})) << name_of(kind);
  }
  const auto grey = random_source({1, 2, 2, 2, 1}, DType::u8, 3);
  for (const Kind kind : {Kind::ycrcb, Kind::logluv}) {
    expect_error(ErrorKind::input, {"--transform", name_of(kind), "three", "1"}, [&] {
      choose_colour_transform(*grey, {kind, {}}, job);
    });
  }
  EXPECT_EQ(choose_colour_transform(*grey, {Kind::decorrelated, {}}, job).axes,
            std::vector<double>{1});
  expect_error(ErrorKind::input, {"--channel-weights", "2", "1"}, [&] {
    choose_colour_transform(*grey, {Kind::log, {1, 2}}, job);
  });
}

TEST(ColourSource, RefusesWhatHasNoTransform) {
  const BtfShape shape{2, 2, 3, 4, 3};
  std::vector<double> values = random_values(shape.values(), 3, 0, 1);
  Job job;
  // view 1, light 0, row 2, column 1, channel 2
  const std::size_t at = ((2 * 3 + 2) * 4 + 1) * 3 + 2;
  values[at] = -0.25, values[at + 1] = -1;
  const auto negative = source_of(shape, DType::f32, values);
  expect_error(ErrorKind::input,
               {"logluv", "-0.25", "view 1", "light 0", "row 2", "column 1", "channel 2"}, [&] {
                 choose_colour_transform(*negative, {Kind::logluv, {}}, job);
               });
  EXPECT_NO_THROW(choose_colour_transform(*negative, {Kind::log, {}}, job));
  values[at] = std::nan("");
  const auto bad = source_of(shape, DType::f32, values);
  for (const Kind kind : {Kind::log, Kind::logluv, Kind::decorrelated}) {
    expect_error(ErrorKind::input, {"NaN", "view 1, light 0, row 2, column 1, channel 2"}, [&] {
      choose_colour_transform(*bad, {kind, {}}, job);
    });
  }
  TransformedSource ycrcb(*bad, choose_colour_transform(*bad, {Kind::ycrcb, {}}, job), false);
  std::vector<std::byte> image(ycrcb.info().image_bytes());
  expect_error(ErrorKind::input, {"NaN", "view 1, light 0, row 2, column 1, channel 2"},
               [&] { ycrcb.read(2, 1, image); });
  // read as 0, in every channel that takes it
  TransformedSource zeroed(*bad, choose_colour_transform(*bad, {Kind::ycrcb, {}}, job), true);
  zeroed.read(2, 1, image);
  for (const double value : decode_values(image, DType::f32)) EXPECT_TRUE(std::isfinite(value));
}

// Parts of images, of sources that are mapped or give parts themselves, are those of the images.
TEST(TransformedParts, AreThoseOfTheImages) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const std::vector<std::byte> bytes = encode_values(random_values(shape.values(), 5), DType::u8);
  Job job;
  for (const bool mapped : {true, false}) {
    MemorySource memory(make_info(shape, DType::u8), bytes, mapped);
    TransformedSource inner(memory, choose_colour_transform(memory, {Kind::ycrcb, {}}, job), false);
    TransformedSource outer(inner, choose_colour_transform(inner, {Kind::log, {}}, job), false);
    std::vector<std::byte> image(outer.info().image_bytes());
    std::vector<std::byte> part(7 * 3 * sizeof(float));
    for (const std::size_t i : {std::size_t{0}, shape.images() - 1}) {
      outer.read(i, 1, image);
      ASSERT_EQ(outer.read_part(i, 11, 7, part), mapped);
      if (!mapped) continue;
      EXPECT_TRUE(std::equal(part.begin(), part.end(),
                             image.begin() + static_cast<std::ptrdiff_t>(11 * 3 * sizeof(float))));
    }
    std::vector<std::byte> block(shape.images() * part.size());
    read_texels(outer, 11, 7, block);
    EXPECT_TRUE(std::equal(block.end() - static_cast<std::ptrdiff_t>(part.size()), block.end(),
                           image.begin() + static_cast<std::ptrdiff_t>(11 * 3 * sizeof(float))));
  }
}

}  // namespace
}  // namespace weft::test
