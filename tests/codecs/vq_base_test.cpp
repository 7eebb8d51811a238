// Materials compressed into one data base: on the device and by the reference, as models of their
// own, added later without a bit changed, by goals; and mip levels.
#include "weft/codecs/vq_base.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "weft/codecs/vq.hpp"
#include "weft/model/model_file.hpp"

namespace weft::test {
namespace {

// Two kinds of texels, of a material's brightness, colour and share of each kind: materials that
// have code-vectors in common.
std::shared_ptr<MemorySource> material(std::size_t height, std::size_t width, double brightness,
                                       std::size_t one_in) {
  const BtfShape shape{6, 7, height, width, 3};
  Random random(17);
  std::vector<double> kinds(2 * shape.images());
  for (double& value : kinds) value = random.uniform(0.2, 1);
  std::vector<double> values;
  for (std::size_t i = 0; i < shape.images(); ++i) {
    for (std::size_t p = 0; p < shape.texels(); ++p) {
      const double kind = kinds[(p % one_in == 0 ? 1 : 0) * shape.images() + i];
      const double texel = brightness * (0.5 + 0.5 * static_cast<double>(p % 7) / 7) * kind;
      values.insert(values.end(), {texel, 0.1 * brightness, 0.05});
    }
  }
  return source_of(shape, DType::f32, values);
}

CompressRequest request_of(const Parameters& parameters, const std::string& storage = "f32") {
  CompressRequest request;
  request.parameters = parameters;
  request.storage = storage_request(storage);
  return request;
}

VqBaseResult compress(bool on_device, std::span<const MaterialSource> materials,
                      const CompressRequest& request, const VqBase* existing = nullptr) {
  Job job;
  return compress_vq_base(on_device ? &shared_device() : nullptr, materials, request, existing,
                          job);
}

std::vector<double> decoded(const Model& model) {
  return CodecRun{"vq", false}.decode(model, 42);
}

const std::vector<MaterialSource>& both() {
  static const std::vector<MaterialSource> materials{{"wool", material(8, 9, 1, 3), "{}", {}},
                                                     {"cord", material(5, 12, 0.25, 2), "{}", {}}};
  return materials;
}

TEST(VqBaseCodec, DeviceAndReferenceShareTheSameCodeBooks) {
  const CompressRequest request = request_of({{"threshold", "0.02"}, {"levels", "3"}});
  const VqBaseResult device = compress(true, both(), request);
  const VqBaseResult reference = compress(false, both(), request);
  EXPECT_EQ(device.base.books.sizes, reference.base.books.sizes);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto a = device.base.model(i);
    const auto b = reference.base.model(i);
    EXPECT_EQ(a->coarser.size(), 2U);
    EXPECT_TRUE(all_near(decoded(*a), decoded(*b), 1e-5));
    // measured as what is stored
    const double relative_error = relative(CodecRun{"vq", true}.measure(*a, *both()[i].source));
    EXPECT_NEAR(device.measured[i].errors.relative, relative_error, 1e-6);
    EXPECT_NEAR(device.base.materials[i].index.info.errors->relative, relative_error, 1e-6);
    EXPECT_LT(relative_error, 0.05);
  }
}

// One material is what a model of its own is; two that are alike take less than two models.
TEST(VqBaseCodec, MaterialsShareCodeVectors) {
  const Parameters parameters{{"threshold", "0.02"}};
  std::size_t alone = 0;
  for (const MaterialSource& one : both()) {
    const VqBaseResult single = compress(true, {&one, 1}, request_of(parameters));
    const auto model = CodecRun{"vq", true}.encode(*one.source, parameters, Storage::f32);
    EXPECT_EQ(decoded(*single.base.model(0)), decoded(*model));
    alone += vq_base_bytes(single.base).shared;
  }
  const VqBaseResult shared = compress(true, both(), request_of(parameters));
  EXPECT_LT(vq_base_bytes(shared.base).shared, alone * 3 / 4);
}

// What was there decodes to the same bits when materials are added, however it is stored; and again
// from the file.
TEST(VqBaseCodec, AddedMaterialsLeaveOthersAsTheyAre) {
  const TemporaryFolder folder;
  const MaterialSource added{"silk", material(6, 6, 3000, 4), "{}", {}};
  const MaterialSource other{
      "felt", random_source({6, 7, 4, 4, 3}, DType::f32, 9, 0.1, 50), "{}", {}};
  for (const char* const storage : {"f16", "f32", "q=8"}) {
    const CompressRequest request = request_of({{"threshold", "0.05"}}, storage);
    VqBase base = compress(true, both(), request).base;
    std::vector<std::vector<double>> before;
    for (const MaterialSource& next : {added, other}) {
      before.clear();
      for (std::size_t i = 0; i < base.materials.size(); ++i) {
        before.push_back(decoded(*base.model(i)));
      }
      VqBaseResult more = compress(true, {&next, 1}, request, &base);
      ASSERT_EQ(more.base.materials.size(), before.size() + 1);
      EXPECT_GT(more.base.books.sizes.p4, base.books.sizes.p4);
      for (std::size_t i = 0; i < before.size(); ++i) {
        EXPECT_EQ(decoded(*more.base.model(i)), before[i]) << storage;
      }
      EXPECT_LT(more.measured[0].errors.relative, 0.1) << storage;
      const auto path = folder / "base.weft";
      write_vq_base(path, more.base);
      base = VqBase::read(path);
      for (std::size_t i = 0; i < before.size(); ++i) {
        EXPECT_EQ(decoded(*base.model(i)), before[i]) << storage;
      }
      const std::size_t last = before.size();
      EXPECT_EQ(decoded(*base.model(last)), decoded(*more.base.model(last))) << storage;
    }
    EXPECT_EQ(base.books.earlier.size(), 2U);
  }
}

// The same again takes no code-vectors of its own.
TEST(VqBaseCodec, WhatIsThereAlreadyIsFound) {
  const CompressRequest request = request_of({{"threshold", "0.05"}});
  const VqBase base = compress(true, both(), request).base;
  MaterialSource again = both()[0];
  again.name = "again";
  const VqBaseResult more = compress(true, {&again, 1}, request, &base);
  EXPECT_EQ(more.base.books.sizes, base.books.sizes);
  EXPECT_EQ(decoded(*more.base.model(2)), decoded(*base.model(0)));
}

TEST(VqBaseCodec, WhatMaterialsHaveInCommonIsChecked) {
  const CompressRequest request = request_of({{"threshold", "0.1"}});
  const auto expect_refused = [&](std::initializer_list<std::string_view> parts,
                                  const MaterialSource& second, const CompressRequest& wanted) {
    const std::vector<MaterialSource> materials{both()[0], second};
    expect_error(ErrorKind::input, parts, [&] { compress(true, materials, wanted); });
    if (wanted.storage.kind == StorageRequest::Kind::automatic) return;
    const VqBase base = compress(true, {both().data(), 1}, wanted).base;
    expect_error(ErrorKind::input, parts, [&] { compress(true, {&second, 1}, wanted, &base); });
  };
  MaterialSource second = both()[1];
  second.name = "wool";
  expect_refused({"material 'wool'", "--names"}, second, request);
  second.name = "cord";
  second.source = random_source({6, 7, 4, 4, 1}, DType::f32, 3);
  expect_refused({"material 'cord'", "channels 1", "'wool' 3"}, second, request);
  second.source = random_source({6, 6, 4, 4, 3}, DType::f32, 3);
  expect_refused({"material 'cord'", "grid"}, second, request);
  second = both()[1];
  second.colour.kind = ColourTransform::Kind::ycrcb;
  expect_refused({"material 'cord'", "colour transform ycrcb", "none"}, second, request);
  expect_refused({"--storage auto"}, both()[1], request_of({}, "auto"));
  const VqBase base = compress(true, {both().data(), 1}, request).base;
  expect_error(ErrorKind::input, {"--storage", "stored as f32"}, [&] {
    compress(true, {both().data() + 1, 1}, request_of({}, "f16"), &base);
  });
}

TEST(VqBaseCodec, GoalsAreMetByAll) {
  const auto run = [&](const std::string& target, const VqBase* existing,
                       std::span<const MaterialSource> materials) {
    CompressRequest request = request_of({});
    request.goal = parse_goal(target, materials.front().source->info());
    return compress(true, materials, request, existing);
  };
  const VqBaseResult exact = run("rel=0.03", nullptr, both());
  for (const MeasuredModel& one : exact.measured) EXPECT_LE(one.errors.relative, 0.03);
  const std::size_t bytes = vq_base_size(exact.base);
  const VqBaseResult coarse = run("snr=15", nullptr, both());
  for (const MeasuredModel& one : coarse.measured) EXPECT_GE(one.errors.snr, 15);
  EXPECT_LE(vq_base_size(coarse.base), bytes);
  const VqBaseResult small = run("size=" + std::to_string(bytes), nullptr, both());
  EXPECT_LE(vq_base_size(small.base), bytes);
  // a ratio is of all that was raw
  const MaterialSource again{"again", both()[0].source, "{}", {}};
  const VqBaseResult more = run("ratio=2", &small.base, {&again, 1});
  const std::size_t raw = both()[0].source->info().bytes() * 2 + both()[1].source->info().bytes();
  EXPECT_LE(vq_base_size(more.base) * 2, raw);
  expect_error(ErrorKind::unmet_goal, {"--target size=100", "by the file"},
               [&] { run("size=100", nullptr, both()); });
}

// BRDFs, each a material of one texel, have the code-vectors that they have as a row of texels, of
// the same luminance.
TEST(VqBaseCodec, BrdfsAreMaterialsOfOneTexel) {
  constexpr std::size_t count = 5;
  const BtfShape row_shape{6, 7, 1, count, 3};
  Random random(4);
  std::vector<double> row(row_shape.values());
  for (double& value : row) value = random.uniform(0.2, 1);
  std::vector<MaterialSource> brdfs;
  for (std::size_t p = 0; p < count; ++p) {
    std::vector<double> texel;
    for (std::size_t i = 0; i < row_shape.images(); ++i) {
      const auto value = row.begin() + static_cast<std::ptrdiff_t>((i * count + p) * 3);
      texel.insert(texel.end(), value, value + 3);
    }
    brdfs.push_back(
        {"brdf" + std::to_string(p), source_of({6, 7, 1, 1, 3}, DType::f32, texel), "{}", {}});
  }
  const MaterialSource together{"row", source_of(row_shape, DType::f32, row), "{}", {}};
  const CompressRequest request = request_of({{"threshold", "0"}});
  const VqBase each = compress(true, brdfs, request).base;
  const VqBase as_row = compress(true, {&together, 1}, request).base;
  EXPECT_EQ(each.books.sizes, as_row.books.sizes);
  const std::vector<double> texels = decoded(*as_row.model(0));
  for (std::size_t p = 0; p < count; ++p) {
    const std::vector<double> one = decoded(*each.model(p));
    for (std::size_t i = 0; i < one.size(); ++i) {
      EXPECT_NEAR(one[i], texels[(i / 3 * count + p) * 3 + i % 3], 1e-6);
    }
  }
}

// A level is what the averages are, and takes indices alone of code-vectors that are there.
TEST(VqLevels, AreFittedToAverages) {
  const auto source = random_source({6, 7, 13, 10, 3}, DType::u8, 5);
  Selection selection;
  for (const bool on_device : {true, false}) {
    const auto model = CodecRun{"vq", on_device}.encode(
        *source, {{"threshold", "0.001"}, {"levels", "all"}}, Storage::f32);
    const Codec& codec = vq_codec();
    std::unique_ptr<Model> level = codec.select(*model, {});
    for (selection.level = 1; selection.level <= 4; ++selection.level) {
      ASSERT_TRUE(codec.holds_mip_level(*level));
      level = codec.next_mip_level(*level);
      const auto averages = select(source, selection);
      EXPECT_EQ(level->info.btf.shape, averages->info().shape);
      EXPECT_LT(relative(CodecRun{"vq", on_device}.measure(*level, *averages)), 0.01);
    }
    EXPECT_FALSE(codec.holds_mip_level(*level));
  }
  expect_error(ErrorKind::input, {"--levels 6", "have 5"}, [&] {
    CodecRun{"vq", true}.encode(*source, {{"levels", "6"}}, Storage::f32);
  });
  expect_error(ErrorKind::input, {"--levels 0"}, [&] {
    CodecRun{"vq", true}.encode(*source, {{"levels", "0"}}, Storage::f32);
  });
}

}  // namespace
}  // namespace weft::test
