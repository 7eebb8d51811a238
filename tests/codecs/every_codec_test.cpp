// What holds for every codec of the table, on the device and by the reference: models that survive
// their file, decoding in any runs, selections and single texels alike, extremes of shape and
// magnitude, values that are refused, bits that do not depend on memory.
#include <gtest/gtest.h>

#include <filesystem>
#include <limits>

#include "codecs/codec_runs.hpp"
#include "codecs/random_lookups.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/guarded_buffer.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/adapt.hpp"
#include "weft/btf/mip.hpp"
#include "weft/codecs/store_model.hpp"
#include "weft/model/storage.hpp"

namespace weft::test {
namespace {

class EveryCodec : public testing::TestWithParam<CodecRun> {
 protected:
  const CodecRun& run() const { return GetParam(); }
};

INSTANTIATE_TEST_SUITE_P(Table, EveryCodec, testing::ValuesIn(every_run()), run_name);

bool has_mean(const Model& model) {
  const std::vector<ModelTensor> tensors = model.tensors();
  return std::any_of(tensors.begin(), tensors.end(),
                     [](const ModelTensor& tensor) { return tensor.name == "mean"; });
}

Parameters rank(std::size_t k) {
  return {{"rank", std::to_string(k)}};
}

// What any small data is held exactly with: all components, and an atom for every signal.
Parameters everything(const CodecRun& run, std::size_t k) {
  Parameters parameters = rank(k);
  if (run.codec == "sparse") parameters["atoms"] = "1024";
  if (run.codec == "vq") parameters = {{"threshold", "0"}};
  return parameters;
}

TEST_P(EveryCodec, ModelsSurviveTheirFile) {
  const TemporaryFolder folder;
  const auto source = random_source({3, 4, 6, 7, 3}, DType::f16, 5);
  for (const Storage storage : {Storage::f16, Storage::f32}) {
    const auto model = run().encode(*source, rank(3), storage);
    write_model(folder / "m.weft", *model);
    const auto found = read_model(folder / "m.weft");
    EXPECT_EQ(found->info.codec, run().codec);
    EXPECT_EQ(tensor_bytes(*found), tensor_bytes(*model));
    EXPECT_TRUE(all_equal(run().decode(*found, 5), run().decode(*model, 5)));
  }
}

TEST_P(EveryCodec, QuantisedModelsSurviveTheirFile) {
  const TemporaryFolder folder;
  const auto source = random_source({3, 4, 6, 7, 3}, DType::f16, 5);
  const auto fitted = run().encode(*source, rank(3), Storage::f32);
  const std::vector<double> whole = run().decode(*fitted, 5);
  double reference = 0;
  for (const double value : whole) reference += value * value;
  write_model(folder / "m.weft", *fitted);
  double before = std::numeric_limits<double>::infinity();
  for (const unsigned bits : {4u, 7u, 10u, 13u, 16u}) {
    const auto model = read_model(folder / "m.weft");
    quantise_all(*model, bits);
    write_model(folder / "q.weft", *model);
    EXPECT_EQ(std::filesystem::file_size(folder / "q.weft"), model_file_size(*model));
    const auto found = read_model(folder / "q.weft");
    EXPECT_EQ(tensor_bytes(*found), tensor_bytes(*model)) << bits << " bits";
    EXPECT_EQ(found->info.quantised, model->info.quantised);
    const std::vector<double> decoded = run().decode(*found, 5);
    EXPECT_TRUE(all_equal(decoded, run().decode(*model, 5)));
    double squares = 0;
    for (std::size_t i = 0; i < whole.size(); ++i) squares += std::pow(decoded[i] - whole[i], 2);
    EXPECT_LT(squares, before) << bits << " bits";
    before = squares;
  }
  // 16 bits: each factor errs by 2^-16 of its largest value at most, a few times that of its mean
  // one
  EXPECT_LT(before, 40 * 0x1p-32 * reference);
}

TEST_P(EveryCodec, AutomaticStorageKeepsItsBound) {
  const TemporaryFolder folder;
  const auto source = random_source({4, 5, 12, 10, 3}, DType::f16, 5);
  Job job;
  const auto fitted = run().encode(*source, rank(3), Storage::f32, job);
  const auto squares = [&](const Model& model) {
    return run().measure(model, *source).square_difference;
  };
  Device* const device = run().on_device ? &shared_device() : nullptr;
  write_model(folder / "m.weft", *fitted);
  const auto half = read_model(folder / "m.weft");
  set_storage(*half, Storage::f16);
  round_to_storage(*half);
  std::size_t size = model_file_size(*half);
  for (const char* slack : {"auto=0.01", "auto=0.2"}) {
    const auto model = read_model(folder / "m.weft");
    const StorageRequest request = storage_request(slack);
    store_model(device, *model, *source, request, job);
    EXPECT_LE(squares(*model), std::pow(1 + request.slack, 2) * squares(*half));
    // the more may be lost, the less it takes
    EXPECT_LE(model_file_size(*model), size) << slack;
    size = model_file_size(*model);
    write_model(folder / "a.weft", *model);
    EXPECT_EQ(tensor_bytes(*read_model(folder / "a.weft")), tensor_bytes(*model));
    // the same bits again
    const auto again = read_model(folder / "m.weft");
    Job other;
    other.memory = std::size_t{64} << 20;
    store_model(device, *again, *source, request, other);
    EXPECT_EQ(tensor_bytes(*again), tensor_bytes(*model));
    EXPECT_EQ(again->info.quantised, model->info.quantised);
  }
  // a bound of one's own, and one that nothing meets
  const double bound = 1.1 * squares(*fitted);
  const auto model = read_model(folder / "m.weft");
  store_model(device, *model, *source, storage_request("auto"), job, {bound});
  EXPECT_FALSE(model->info.quantised.empty());
  EXPECT_LE(squares(*model), bound);
  EXPECT_GE(squares(*model), squares(*fitted) + 0.5 * (bound - squares(*fitted)));
  const auto exact = read_model(folder / "m.weft");
  store_model(device, *exact, *source, storage_request("auto"), job, {0.5 * squares(*fitted)});
  EXPECT_EQ(tensor_bytes(*exact), tensor_bytes(*fitted));
}

TEST_P(EveryCodec, RealValuesAreThoseOfTheRealTensors) {
  const auto source = random_source({3, 4, 6, 7, 3}, DType::f16, 5);
  const auto model = run().encode(*source, rank(3), Storage::f32);
  std::vector<std::span<const std::byte>> values;
  for (const std::span<float> list : model->real_values()) values.push_back(std::as_bytes(list));
  std::size_t n = 0;
  for (const ModelTensor& tensor : model->tensors()) {
    if (tensor.dtype != DType::f32) continue;
    ASSERT_LT(n, values.size());
    EXPECT_EQ(values[n].data(), tensor.values.data()) << tensor.name;
    EXPECT_EQ(values[n].size(), tensor.values.size()) << tensor.name;
    ++n;
  }
  EXPECT_EQ(n, values.size());
}

TEST_P(EveryCodec, HalfStorageChangesLittle) {
  const auto source = random_source({3, 4, 9, 10, 3}, DType::f16, 5);
  const double full =
      relative(run().measure(*run().encode(*source, rank(3), Storage::f32), *source));
  const double half =
      relative(run().measure(*run().encode(*source, rank(3), Storage::f16), *source));
  // Factors and mean are each rounded by 2^-11 of themselves; sqrt(k) components add up.
  EXPECT_NEAR(half, full, 0x1p-11 * (std::sqrt(3.0) + 2) * 2);
  EXPECT_NE(half, full);
}

TEST_P(EveryCodec, RunsOfAnyLengthDecodeAlike) {
  const BtfShape shape{3, 5, 7, 9, 3};
  const auto source = random_source(shape, DType::f16, 5);
  const auto model = run().encode(*source, rank(5), Storage::f16);
  const std::vector<double> whole = run().decode(*model, shape.images());
  for (const std::size_t images : Sizes{1, 2, 4, 14}) {
    EXPECT_TRUE(all_equal(run().decode(*model, images), whole)) << "runs of " << images;
  }
}

TEST_P(EveryCodec, SelectionsAreParts) {
  const BtfShape shape{4, 5, 7, 9, 3};
  const auto source = random_source(shape, DType::f16, 5);
  const auto model = run().encode(*source, rank(6), Storage::f16);
  const std::vector<double> whole = run().decode(*model, shape.images());
  Selection selection;
  selection.views = {{3, 0}};
  selection.lights = {{1, 4, 2}};
  selection.region = Region{2, 1, 5, 6};
  selection.channels = {{2, 0}};
  const auto part = run().get().select(*model, selection);
  ASSERT_EQ(part->info.btf.shape, (BtfShape{2, 3, 6, 5, 2}));
  std::vector<double> expected;
  for (const std::size_t v : *selection.views) {
    for (const std::size_t l : *selection.lights) {
      for (std::size_t y = 1; y < 7; ++y) {
        for (std::size_t x = 2; x < 7; ++x) {
          for (const std::size_t c : *selection.channels) {
            expected.push_back(
                whole[(((v * shape.lights + l) * shape.height + y) * shape.width + x) * 3 + c]);
          }
        }
      }
    }
  }
  // The same products; a device may fuse them otherwise in the last texels of a row of panels.
  const double tolerance = run().get().decode_tolerance(*model);
  EXPECT_TRUE(all_near(run().decode(*part, 6), expected, tolerance));
  // and a part has a file of its own
  const TemporaryFolder folder;
  write_model(folder / "part.weft", *part);
  EXPECT_TRUE(all_near(run().decode(*read_model(folder / "part.weft"), 4), expected, tolerance));
}

TEST_P(EveryCodec, OneTexelIsThatOfTheImage) {
  const BtfShape shape{3, 4, 5, 6, 3};
  const auto source = random_source(shape, DType::f16, 5);
  const auto model = run().encode(*source, rank(5), Storage::f16);
  const std::vector<double> whole = run().decode(*model, shape.images());
  const double tolerance = run().get().decode_tolerance(*model);
  std::vector<double> texel(3);
  for (std::size_t i = 0; i < shape.values(); i += 3) {
    const std::size_t p = i / 3 % shape.texels();
    const std::size_t image = i / shape.image_values();
    model->decode_texel(image / shape.lights, image % shape.lights, p / shape.width,
                        p % shape.width, texel);
    ASSERT_TRUE(all_near(texel, std::span(whole).subspan(i, 3), tolerance));
  }
}

// A model of either encoder is decoded by both, within the bound that `weft verify` uses.
TEST_P(EveryCodec, DeviceAndReferenceDecodeAlike) {
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    const auto source = random_source({4, 4, 17, 13, 3}, dtype, 9);
    const auto model = run().encode(*source, rank(7), Storage::f16);
    const CodecRun device{run().codec, true};
    const CodecRun reference{run().codec, false};
    EXPECT_TRUE(all_near(device.decode(*model, 7), reference.decode(*model, 7),
                         run().get().decode_tolerance(*model)));
    const double error = relative(reference.measure(*model, *source));
    EXPECT_NEAR(relative(device.measure(*model, *source)), error, 1e-5 * error);
  }
}

std::vector<float> look_up(DeviceSampler& sampler, const LookupShape& lookup, const BtfShape& shape,
                           std::span<const std::uint32_t> records) {
  const std::size_t count = records.size() / lookup.words();
  GuardedBuffer lookups(shared_device(), records, "look-ups");
  GuardedBuffer out(shared_device(), count * shape.channels * sizeof(float), "values");
  sampler.look_up(lookup, count, lookups.buffer(), out.buffer());
  std::vector<float> values = out.values<float>();
  EXPECT_TRUE(out.intact());
  EXPECT_TRUE(lookups.intact());
  return values;
}

// Sums of taps by the definition, of what the model says of each texel.
TEST_P(EveryCodec, SmallLookupsAreSumsOfTexels) {
  for (const std::size_t channels : Sizes{1, 3, 4}) {
    const BtfShape shape{3, 4, 5, 6, channels};
    const auto source = random_source(shape, DType::f16, 5);
    const auto model = run().encode(*source, rank(channels == 3 ? 9 : 3), Storage::f16);
    const auto sampler = run().get().sampler(shared_device(), *model);
    EXPECT_GT(run().get().sampler_bytes(*model), 0U);
    const auto reference = run().get().reference_sampler(*model);
    Random random(11);
    std::vector<LookupShape> lookups{{4, 3, 3}};
    if (channels == 1) lookups = {{4, 1, 3}};
    if (channels == 3) lookups.insert(lookups.end(), {{1, 1, 1}, {4, 3, 1}});
    for (const LookupShape& lookup : lookups) {
      const std::size_t count = is_simulator(shared_device()) ? 5 : 131;
      const std::vector<std::uint32_t> records = random_lookups(lookup, shape, count, random);
      std::vector<double> expected(count * channels, 0.0);
      std::vector<double> texel(channels);
      for (std::size_t i = 0; i < count; ++i) {
        const Lookup taps(lookup, std::span(records).subspan(i * lookup.words(), lookup.words()));
        for (std::size_t n = 0; n < lookup.texels * lookup.views * lookup.lights; ++n) {
          const std::size_t t = n % lookup.texels;
          const std::size_t v = n / lookup.texels % lookup.views;
          const std::size_t l = n / lookup.texels / lookup.views;
          model->decode_texel(taps.views[v], taps.lights[l], taps.texels[t] / shape.width,
                              taps.texels[t] % shape.width, texel);
          for (std::size_t c = 0; c < channels; ++c) {
            expected[i * channels + c] +=
                taps.texel_weight(t) * taps.view_weight(v) * taps.light_weight(l) * texel[c];
          }
        }
      }
      const double tolerance = lookup_tolerance(run().get(), *model, lookup);
      EXPECT_TRUE(all_near(look_up(*sampler, lookup, shape, records), expected, tolerance));
      std::vector<double> by_reference(expected.size());
      reference->look_up(lookup, records, by_reference);
      EXPECT_TRUE(all_near(by_reference, expected, tolerance));
    }
  }
}

// A look-up's bits are its record's alone: in whatever batch it comes.
TEST_P(EveryCodec, LookupsOfAnyBatchGiveTheSameBits) {
  const BtfShape shape{4, 5, 7, 9, 3};
  const LookupShape lookup{4, 3, 3};
  const auto source = random_source(shape, DType::f16, 5);
  const auto model = run().encode(*source, rank(11), Storage::f16);
  const auto sampler = run().get().sampler(shared_device(), *model);
  Random random(3);
  const std::vector<std::uint32_t> records = random_lookups(lookup, shape, 193, random);
  const std::vector<float> whole = look_up(*sampler, lookup, shape, records);
  for (const std::size_t count : Sizes{1, 63, 64, 65, 128}) {
    const auto part =
        look_up(*sampler, lookup, shape, std::span(records).last(count * lookup.words()));
    EXPECT_TRUE(all_equal(part, std::span(whole).last(count * 3))) << count;
  }
}

// Where a model has mip levels of its own, they are those of its images.
TEST_P(EveryCodec, MipLevelsOfModelsAreThoseOfTheirImages) {
  for (const Encoding encoding : {Encoding::linear, Encoding::srgb}) {
    const BtfShape shape{2, 3, 7, 10, 3};
    const auto random = random_source(shape, DType::f16, 5);
    const auto source = relabelled(random, encoding, std::nullopt);
    const auto model = run().encode(*source, rank(6), Storage::f32);
    const auto half = run().get().next_mip_level(*model);
    if (!half) continue;
    EXPECT_EQ(encoding, Encoding::linear);
    EXPECT_EQ(half->info.btf.shape, (BtfShape{2, 3, 4, 5, 3}));
    const std::vector<double> values = run().decode(*model, shape.images());
    std::vector<double> expected;
    for (std::size_t image = 0; image < shape.images(); ++image) {
      std::vector<float> pixels(shape.image_values());
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        pixels[i] = static_cast<float>(values[image * pixels.size() + i]);
      }
      pixels.resize(average_mip(pixels, shape.height, shape.width, 3, 1));
      expected.insert(expected.end(), pixels.begin(), pixels.end());
    }
    // decoded on both sides, and rounded to float before and after the average
    const double tolerance = 4 * run().get().decode_tolerance(*model);
    EXPECT_TRUE(all_near(run().decode(*half, shape.images()), expected, tolerance));
  }
}

TEST_P(EveryCodec, ExtremesOfShape) {
  const BtfShape shapes[] = {{1, 1, 1, 1, 1},  {1, 1, 1, 1, 3}, {1, 1, 8, 8, 3}, {1, 12, 6, 5, 3},
                             {9, 1, 6, 5, 3},  {3, 3, 1, 1, 3}, {3, 3, 6, 5, 1}, {2, 2, 5, 5, 7},
                             {2, 3, 1, 40, 4}, {3, 2, 40, 1, 2}};
  for (const BtfShape& shape : shapes) {
    for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
      SCOPED_TRACE(testing::PrintToString(shape.values()) + " values of " +
                   std::string(name_of(dtype)));
      // full rank and beyond: exact but for rounding
      const auto random = random_source(shape, dtype, 4, 0.25, 1.0);
      EXPECT_LE(relative(run().measure(
                    *run().encode(*random, everything(run(), 1000), Storage::f32), *random)),
                1e-5);
      // all zero, and constant
      for (const double constant : {0.0, 0.5}) {
        const auto flat = source_of(shape, dtype, std::vector<double>(shape.values(), constant));
        // 8-bit values are not floats: the mean is rounded. Models without one are projections on
        // five modes and back: no more than 40 roundings each.
        const auto model = run().encode(*flat, rank(4), Storage::f32);
        const double roundings = has_mean(*model) ? 1 : 5 * 40;
        EXPECT_LE(run().measure(*model, *flat).max_difference, constant * 0x1p-24 * roundings);
      }
    }
  }
}

// Data that its codec holds exactly comes back whatever its magnitude.
TEST_P(EveryCodec, MagnitudesFrom1eMinus30To1e30) {
  const BtfShape shape{3, 4, 9, 10, 3};
  for (const double magnitude : {1e-42, 1e-38, 1e-30, 1e-10, 1e10, 1e30}) {
    std::vector<double> values = random_values(shape.values(), 6, -1, 1);
    for (double& value : values) value *= magnitude;
    const auto source = source_of(shape, DType::f32, values);
    const ErrorSums sums =
        run().measure(*run().encode(*source, everything(run(), 90), Storage::f32), *source);
    // Three factors are rounded, and sums of up to 90 products; what is left of subnormal data has
    // absolute steps of 2^-149.
    const double steps = 0x1p-149 * std::sqrt(static_cast<double>(sums.count)) * 90;
    EXPECT_LE(std::sqrt(sums.square_difference),
              4 * 93 * 0x1p-24 * std::sqrt(sums.square_reference) + steps)
        << magnitude;
  }
}

TEST_P(EveryCodec, RefusesNaNAndNamesTheFirst) {
  const BtfShape shape{2, 3, 4, 5, 3};
  std::vector<double> values = random_values(shape.values(), 3);
  // view 1, light 0, row 2, column 3, channel 1; and a later one
  values[(((1 * 3 + 0) * 4 + 2) * 5 + 3) * 3 + 1] = std::numeric_limits<double>::quiet_NaN();
  values[values.size() - 1] = std::numeric_limits<double>::infinity();
  for (const DType dtype : {DType::f16, DType::f32}) {
    const auto source = source_of(shape, dtype, values);
    expect_error(ErrorKind::input, {"view 1, light 0, row 2, column 3, channel 1"},
                 [&] { run().encode(*source, rank(2), Storage::f16); });
    Job job;
    job.nan_zero = true;
    const auto model = run().encode(*source, run().codec == "vq" ? everything(run(), 60) : rank(60),
                                    Storage::f32, job);
    EXPECT_LE(relative(run().measure(*model, *source, true)), 1e-5);
  }
}

// Sums of such values leave the range of float.
TEST_P(EveryCodec, RefusesLargerMagnitudesAndNamesTheFirst) {
  const BtfShape shape{2, 3, 4, 5, 3};
  std::vector<double> values = random_values(shape.values(), 3);
  const std::size_t at = (((1 * 3 + 0) * 4 + 2) * 5 + 3) * 3 + 1;
  values[at] = -3e38;
  values[at + 1] = std::numeric_limits<double>::quiet_NaN();
  values[values.size() - 1] = 3e38;
  const auto source = source_of(shape, DType::f32, values);
  for (const bool nan_zero : {false, true}) {
    Job job;
    job.nan_zero = nan_zero;
    expect_error(ErrorKind::input, {"-3e+38", "view 1, light 0, row 2, column 3, channel 1"},
                 [&] { run().encode(*source, rank(2), Storage::f16, job); });
  }
  values[at] = std::numeric_limits<double>::quiet_NaN();
  values[at + 1] = -3e38;
  expect_error(ErrorKind::input, {"NaN", "view 1, light 0, row 2, column 3, channel 1"},
               [&] { run().encode(*source_of(shape, DType::f32, values), rank(2), Storage::f16); });
}

// The same bits whatever the memory limit, and whether the input is mapped or read.
TEST_P(EveryCodec, SameBitsWhateverTheMemory) {
  const BtfShape shape{6, 7, 12, 11, 3};
  const auto bytes = encode_values(random_values(shape.values(), 8), DType::f16);
  MemorySource mapped(make_info(shape, DType::f16), bytes, true);
  MemorySource read(make_info(shape, DType::f16), bytes, false);
  Job small;
  small.memory = std::size_t{64} << 20;
  EXPECT_EQ(tensor_bytes(*run().encode(mapped, rank(5), Storage::f16)),
            tensor_bytes(*run().encode(read, rank(5), Storage::f16, small)));
}

TEST_P(EveryCodec, RefusesWhatDoesNotFit) {
  const auto source = random_source({3, 4, 9, 10, 3}, DType::f16, 4);
  Job job;
  job.memory = 1000;
  expect_error(ErrorKind::input, {"--memory 1000"},
               [&] { run().encode(*source, rank(4), Storage::f16, job); });
  EXPECT_EQ(source->images_read(), 0U);
}

TEST_P(EveryCodec, ParametersAreChecked) {
  const auto source = random_source({1, 2, 3, 4, 3}, DType::f16, 4);
  if (run().codec == "vq") {
    for (const auto& [name, text] : std::vector<std::pair<std::string, std::string>>{
             {"threshold", "-1"},
             {"threshold", "x"},
             {"threshold", ""},
             {"threshold", "1,"},
             {"threshold", "nan"},
             {"threshold", "1,1,1,1,1,1,1,1,1"},
             {"samples", "101"},
             {"samples", "1,2,3"},
             {"grid", "round"},
             {"slices", "11,11"},
         }) {
      expect_error(ErrorKind::input, {"--" + name, text}, [&] {
        run().encode(*source, {{name, text}}, Storage::f16);
      });
    }
    return;
  }
  for (const char* text : {"0", "-1", "x", "", "3.5", "99999999999999999999999"}) {
    expect_error(ErrorKind::input, {"--rank", text}, [&] {
      run().encode(*source, {{"rank", text}}, Storage::f16);
    });
  }
}

TEST_P(EveryCodec, PairedDirections) {
  BtfInfo info = make_info({6, 1, 5, 8, 3}, DType::f16);
  info.layout = Layout::paired;
  info.light_directions = info.view_directions;
  const auto bytes = encode_values(random_values(info.shape.values(), 8), DType::f16);
  MemorySource source(info, bytes);
  const auto model = run().encode(source, everything(run(), 100), Storage::f32);
  EXPECT_LE(relative(run().measure(*model, source)), 1e-5);
  Selection selection;
  selection.views = {{4, 1}};
  EXPECT_EQ(run().get().select(*model, selection)->info.btf.shape, (BtfShape{2, 1, 5, 8, 3}));
}

}  // namespace
}  // namespace weft::test
