// Models of masks: of every codec, on the device and by the reference, in files and in selections.
#include "weft/codecs/occlusion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "model/edit_model.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "support/shared_device.hpp"
#include "support/temporary_folder.hpp"
#include "weft/btf/mask_distance.hpp"
#include "weft/codecs/compress.hpp"
#include "weft/codecs/goal.hpp"
#include "weft/model/file_sizer.hpp"

namespace weft::test {
namespace {

constexpr BtfShape shape{6, 2, 20, 17, 3};
constexpr std::size_t texels = 20 * 17;

// Two threads that shift with the view.
std::vector<std::uint8_t> threads_mask() {
  std::vector<std::uint8_t> mask;
  for (std::size_t v = 0; v < shape.views; ++v) {
    for (std::size_t y = 0; y < shape.height; ++y) {
      for (std::size_t x = 0; x < shape.width; ++x) {
        const bool warp = (x + v) % 17 < 5;
        const bool weft = (y + 2 * v) % 20 < 6;
        mask.push_back(warp || weft ? 1 : 0);
      }
    }
  }
  return mask;
}

BtfInfo masked_info(std::vector<std::uint8_t> mask) {
  BtfInfo info = make_info(shape, DType::f32);
  info.mask = std::move(mask);
  return info;
}

struct MaskCodec {
  const char* codec;
  Parameters parameters;
};

const std::vector<MaskCodec>& mask_codecs() {
  static const std::vector<MaskCodec> list{
      {"tucker", {{"ranks", "v=4,y=8,x=8"}}},
      {"tt", {{"ranks", "8,6,6,1"}}},
      {"cta", {{"clusters", "2"}, {"ranks", "v=2,y=8,x=8"}}},
      {"kcta", {{"clusters", "3"}, {"mixtures", "2"}, {"ranks", "v=1,y=8,x=8"}}},
      {"pca", {{"rank", "4"}}}};
  return list;
}

OcclusionRequest request_of(const MaskCodec& codec, OcclusionKind kind) {
  OcclusionRequest request;
  request.codec = &find_codec(codec.codec);
  request.parameters = codec.parameters;
  request.storage = storage_request("f16");
  request.kind = kind;
  request.mapping = default_mapping(kind);
  return request;
}

// A model whose values matter little, with that of its mask.
std::unique_ptr<Model> model_with(std::shared_ptr<const Occlusion> occlusion) {
  const auto source = random_source(shape, DType::f32, 5);
  Job job;
  auto model = find_codec("pca").encode_reference(*source, {{"rank", "2"}}, Storage::f16, job);
  model->info.selection = "{}";
  model->info.occlusion = std::move(occlusion);
  return model;
}

std::size_t wrong_by_brute_force(const std::vector<std::uint8_t>& mask, const Model& model,
                                 OcclusionKind kind) {
  std::size_t wrong = 0;
  for (std::size_t v = 0; v < shape.views; ++v) {
    for (std::size_t y = 0; y < shape.height; ++y) {
      for (std::size_t x = 0; x < shape.width; ++x) {
        double value = 0;
        model.decode_texel(v, 0, y, x, std::span(&value, 1));
        const bool visible = kind == OcclusionKind::mask ? value >= 0.5 : value > 0;
        const bool wanted = mask[v * texels + y * shape.width + x] != 0;
        wrong += visible != wanted ? 1 : 0;
      }
    }
  }
  return wrong;
}

TEST(OcclusionModel, OfEveryCodecOnDeviceAndReference) {
  const BtfInfo info = masked_info(threads_mask());
  TemporaryFolder folder;
  for (const MaskCodec& codec : mask_codecs()) {
    for (const OcclusionKind kind : {OcclusionKind::mask, OcclusionKind::distance}) {
      SCOPED_TRACE(std::string(codec.codec) + ", " + std::string(name_of(kind)));
      for (Device* device : {&shared_device(), static_cast<Device*>(nullptr)}) {
        Job job;
        const auto occlusion = compress_occlusion(device, info, request_of(codec, kind), job);
        EXPECT_EQ(occlusion->errors.texels, info.mask.size());
        EXPECT_EQ(occlusion->errors.wrong,
                  wrong_by_brute_force(info.mask, *occlusion->model, kind));
        EXPECT_LT(occlusion->errors.share(), 0.2);
        const Codec& of_mask = find_codec(occlusion->model->info.codec);
        const std::vector<float> values = decode_occlusion(&shared_device(), *occlusion, job);
        EXPECT_TRUE(all_near(values, decode_occlusion(nullptr, *occlusion, job),
                             of_mask.decode_tolerance(*occlusion->model)));
        // in a file, and written again as it was
        const auto model = model_with(occlusion);
        const std::size_t size = write_model(folder / "m", *model);
        EXPECT_EQ(size, std::filesystem::file_size(folder / "m"));
        EXPECT_EQ(size, model_file_size(*model));
        const auto read = read_model(folder / "m");
        ASSERT_TRUE(read->info.occlusion);
        EXPECT_TRUE(read->info.btf.mask.empty());
        EXPECT_EQ(read->info.occlusion->kind, kind);
        EXPECT_EQ(read->info.occlusion->mapping, occlusion->mapping);
        EXPECT_EQ(read->info.occlusion->errors, occlusion->errors);
        EXPECT_EQ(read->info.occlusion->model->info.codec, codec.codec);
        EXPECT_TRUE(
            all_equal(decode_occlusion(&shared_device(), *read->info.occlusion, job), values));
        write_model(folder / "again", *read);
        EXPECT_EQ(read_bytes(folder / "again"), read_bytes(folder / "m"));
      }
    }
  }
}

TEST(OcclusionModel, DecodesToAMaskAndItsDistances) {
  const BtfInfo info = masked_info(threads_mask());
  for (const OcclusionKind kind : {OcclusionKind::mask, OcclusionKind::distance}) {
    Job job;
    const auto occlusion =
        compress_occlusion(nullptr, info, request_of(mask_codecs()[0], kind), job);
    const auto model = model_with(occlusion);
    const BtfInfo decoded = with_decoded_mask(nullptr, model->info, job);
    validate(decoded, "decoded");
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < info.mask.size(); ++i) wrong += decoded.mask[i] != info.mask[i];
    EXPECT_EQ(wrong, occlusion->errors.wrong);
    EXPECT_EQ(decoded.mask_distance.empty(), kind == OcclusionKind::mask);
    EXPECT_GT(decoded_mask_bytes(model->info), info.mask.size());
  }
  EXPECT_EQ(decoded_mask_bytes(model_with(nullptr)->info), 0u);
}

TEST(OcclusionModel, AllVisibleAndAllHiddenAreExact) {
  for (const std::uint8_t value : {std::uint8_t{0}, std::uint8_t{1}}) {
    const BtfInfo info = masked_info(std::vector<std::uint8_t>(shape.views * texels, value));
    for (const MaskCodec& codec : mask_codecs()) {
      for (const OcclusionKind kind : {OcclusionKind::mask, OcclusionKind::distance}) {
        Job job;
        const auto occlusion =
            compress_occlusion(&shared_device(), info, request_of(codec, kind), job);
        EXPECT_EQ(occlusion->errors, (ErrorTexels{info.mask.size(), 0}))
            << codec.codec << ", " << name_of(kind) << ", " << int{value};
      }
    }
  }
}

// Of full ranks, whatever the mask, and of distances that a raw BTF has itself.
TEST(OcclusionModel, FullRanksAreExact) {
  Random random(9);
  BtfInfo info = masked_info({});
  for (std::size_t i = 0; i < shape.views * texels; ++i) {
    info.mask.push_back(random.uniform() < 0.5 ? 1 : 0);
    const auto size = static_cast<float>(random.uniform(0.01, 1));
    info.mask_distance.push_back(info.mask.back() != 0 ? size : -size);
  }
  const MaskCodec full{"tucker", {}};
  for (const OcclusionKind kind : {OcclusionKind::mask, OcclusionKind::distance}) {
    Job job;
    const auto occlusion = compress_occlusion(nullptr, info, request_of(full, kind), job);
    EXPECT_EQ(occlusion->errors.wrong, 0u) << name_of(kind);
    if (kind == OcclusionKind::distance) {
      EXPECT_TRUE(all_near(decode_occlusion(nullptr, *occlusion, job), info.mask_distance,
                           [](std::size_t) { return 0x1p-9; }));
    }
  }
}

// Averages over texels of a finer level may have lost their side.
TEST(OcclusionModel, DistancesKeepToTheSideOfTheMask) {
  BtfInfo info = masked_info(threads_mask());
  info.mask_distance.assign(info.mask.size(), 0.0f);
  info.mask_distance[0] = info.mask[0] != 0 ? -0.5f : 0.5f;
  const auto source = occlusion_source(info, OcclusionKind::distance);
  EXPECT_EQ(source->info().shape, (BtfShape{shape.views, 1, shape.height, shape.width, 1}));
  std::vector<float> values(source->info().shape.values());
  source->read(0, shape.views, std::as_writable_bytes(std::span(values)));
  EXPECT_EQ(count_error_texels(info.mask, values, OcclusionKind::distance).wrong, 0u);
}

TEST(OcclusionModel, DistancesAreClippedToTheBand) {
  const BtfInfo info = masked_info(threads_mask());
  const auto read = [&](double band) {
    const auto source = occlusion_source(info, OcclusionKind::distance, band);
    std::vector<float> values(source->info().shape.values());
    source->read(0, shape.views, std::as_writable_bytes(std::span(values)));
    return values;
  };
  const std::vector<float> whole = read(1);
  std::vector<float> clipped;
  for (const float value : whole) clipped.push_back(std::clamp(value, -0.25f, 0.25f));
  EXPECT_EQ(read(0.25), clipped);
  EXPECT_NE(clipped, whole);
}

TEST(OcclusionModel, AGoalOfErrorTexelsIsMet) {
  const BtfInfo info = masked_info(threads_mask());
  for (const char* codec : {"tucker", "tt"}) {
    std::size_t size = 0;
    for (const std::size_t most : Sizes{200, 20, 0}) {
      OcclusionRequest request = request_of({codec, {}}, OcclusionKind::distance);
      request.most_errors = most;
      Job job;
      const auto occlusion = compress_occlusion(&shared_device(), info, request, job);
      EXPECT_LE(occlusion->errors.wrong, most) << codec;
      EXPECT_GE(occlusion_file_size(*occlusion), size) << codec;
      size = occlusion_file_size(*occlusion);
    }
  }
  OcclusionRequest request = request_of({"lpca", {}}, OcclusionKind::distance);
  if (!request.codec->takes_goals()) {
    request.most_errors = 3;
    Job job;
    expect_error(ErrorKind::input, {"--occlusion-errors 3", "lpca"},
                 [&] { compress_occlusion(nullptr, info, request, job); });
  }
  // ranks that are given are the most
  request = request_of({"tucker", {{"ranks", "v=1,y=1,x=1"}}}, OcclusionKind::distance);
  request.most_errors = 0;
  Job job;
  expect_error(ErrorKind::unmet_goal, {"--occlusion-errors 0", "tucker"},
               [&] { compress_occlusion(nullptr, info, request, job); });
}

TEST(OcclusionModel, PartsAreThoseOfTheWhole) {
  const BtfInfo info = masked_info(threads_mask());
  const Region region{3, 5, 9, 8};
  for (const MaskCodec& codec : mask_codecs()) {
    Job job;
    const auto model = model_with(
        compress_occlusion(nullptr, info, request_of(codec, OcclusionKind::distance), job));
    const std::vector<float> whole = decode_occlusion(nullptr, *model->info.occlusion, job);
    Selection selection;
    selection.views = std::vector<std::size_t>{4, 1};
    selection.lights = std::vector<std::size_t>{1};
    selection.region = region;
    selection.channels = std::vector<std::size_t>{2, 0};
    const auto part = find_codec("pca").select(*model, selection);
    std::vector<float> expected;
    for (const std::size_t view : *selection.views) {
      for (std::size_t y = 0; y < region.height; ++y) {
        for (std::size_t x = 0; x < region.width; ++x) {
          expected.push_back(whole[view * texels + (region.y + y) * shape.width + region.x + x]);
        }
      }
    }
    const Codec& of_mask = find_codec(codec.codec);
    EXPECT_TRUE(all_near(decode_occlusion(&shared_device(), *part->info.occlusion, job), expected,
                         2 * of_mask.decode_tolerance(*model->info.occlusion->model)))
        << codec.codec;
    TemporaryFolder folder;
    write_model(folder / "part", *part);
    EXPECT_TRUE(read_model(folder / "part")->info.occlusion);
    // the model itself still has all
    EXPECT_EQ(decode_occlusion(nullptr, *model->info.occlusion, job), whole);
  }
}

// Goals by size are of the whole file, with the model of the mask in it.
TEST(OcclusionModel, CountsInGoals) {
  const auto values = random_source(shape, DType::f32, 6);
  const auto source = std::make_shared<MemorySource>(
      masked_info(threads_mask()), std::vector(values->bytes().begin(), values->bytes().end()));
  Job job;
  const auto occlusion = compress_occlusion(
      nullptr, source->info(), request_of(mask_codecs()[0], OcclusionKind::distance), job);
  for (const char* codec : {"pca", "tt", "tucker"}) {
    CompressRequest request;
    request.codec = &find_codec(codec);
    request.storage = storage_request("f16");
    request.goal = parse_goal("size=24KiB", source->info());
    request.occlusion = occlusion;
    const CompressResult result = compress(&shared_device(), *source, request, job);
    EXPECT_EQ(result.model->info.occlusion, occlusion) << codec;
    EXPECT_TRUE(result.model->info.btf.mask.empty());
    EXPECT_LE(model_file_size(*result.model), std::size_t{24} << 10) << codec;
  }
}

// Of many models with one model of a mask, that is coded once.
TEST(OcclusionModel, IsCodedOnceForSizes) {
  Job job;
  const BtfInfo info = masked_info(threads_mask());
  FileSizer sizer;
  for (const OcclusionKind kind : {OcclusionKind::distance, OcclusionKind::mask}) {
    const std::size_t before = sizer.coded_masks();
    const auto occlusion =
        compress_occlusion(nullptr, info, request_of(mask_codecs()[0], kind), job);
    for (std::size_t i = 0; i < 2; ++i) {
      const auto model = model_with(occlusion);
      EXPECT_EQ(sizer.size(*model), model_file_size(*model));
    }
    EXPECT_EQ(sizer.coded_masks(), before + 1);
  }
}

const std::string& valid_file() {
  static const std::string file = [] {
    TemporaryFolder folder;
    Job job;
    const auto occlusion =
        compress_occlusion(nullptr, masked_info(threads_mask()),
                           request_of(mask_codecs()[0], OcclusionKind::distance), job);
    write_model(folder / "m", *model_with(occlusion));
    return read_bytes(folder / "m");
  }();
  return file;
}

void expect_edit_refused(std::initializer_list<std::string_view> parts,
                         const std::function<void(EditableModel&)>& change) {
  TemporaryFolder folder;
  EditableModel model(valid_file());
  change(model);
  model.set_checksums();
  write_bytes(folder / "m.weft", model.file());
  expect_error(ErrorKind::input, {"m.weft"}, [&] { read_model(folder / "m.weft"); });
  expect_error(ErrorKind::input, parts, [&] { read_model(folder / "m.weft"); });
}

void set_field(EditableModel& model, const char* field, const nlohmann::json& value) {
  auto occlusion = nlohmann::json::parse(model.metadata()["occlusion"].get<std::string>());
  if (value.is_null()) {
    occlusion.erase(field);
  } else {
    occlusion[field] = value;
  }
  model.metadata()["occlusion"] = occlusion.dump();
}

TEST(OcclusionModel, HostileMetadataAreRefused) {
  const auto refused = [](const char* field, const nlohmann::json& value) {
    SCOPED_TRACE(std::string(field) + " " + value.dump());
    expect_edit_refused({"occlusion"}, [&](EditableModel& m) { set_field(m, field, value); });
  };
  for (const char* field :
       {"codec", "of", "parameters", "storage", "texels", "error_texels", "threshold", "weight"}) {
    refused(field, nullptr);
    refused(field, nlohmann::json::array());
  }
  refused("of", "depth");
  refused("storage", "f64");
  refused("parameters", "{}");
  refused("threshold", -1);
  refused("weight", 0);
  refused("texels", -4);
  refused("error_texels", 1u << 30);
  expect_edit_refused({"m.weft", "jpeg"}, [](EditableModel& m) { set_field(m, "codec", "jpeg"); });
  for (const char* text : {"", "[]", "{", "7"}) {
    expect_edit_refused({"occlusion"}, [&](EditableModel& m) { m.metadata()["occlusion"] = text; });
  }
}

TEST(OcclusionModel, HostileTensorsAreRefused) {
  expect_edit_refused({"occlusion.core"}, [](EditableModel& m) {
    m.rename("occlusion.core", "occlusion.kernel");
    m.rename("occlusion.core.scale", "occlusion.kernel.scale");
  });
  // that of another codec
  expect_edit_refused({"occlusion."}, [](EditableModel& m) { set_field(m, "codec", "pca"); });
  expect_edit_refused({"occlusion.factor.v"}, [](EditableModel& m) {
    m.metadata()["shape"] = "[6,2,20,17,3]";
    m.header["occlusion.factor.v"]["shape"] = {4, 6};
  });
  expect_edit_refused({"occlusion.factor.y", "not finite"}, [](EditableModel& m) {
    const std::size_t at = m.begin("occlusion.factor.y");
    m.data[at] = '\xff';
    m.data[at + 1] = '\x7f';
  });
  // a mask besides
  expect_edit_refused({"mask", "there is a model of the mask"}, [](EditableModel& m) {
    m.append("mask", "U8", {6, 20, 17}, std::string(6 * texels, '\1'));
  });
}

TEST(OcclusionModel, NeedsAMask) {
  Job job;
  const BtfInfo info = make_info(shape, DType::f32);
  expect_error(ErrorKind::input, {"no mask"}, [&] {
    compress_occlusion(nullptr, info, request_of(mask_codecs()[0], OcclusionKind::mask), job);
  });
}

}  // namespace
}  // namespace weft::test
