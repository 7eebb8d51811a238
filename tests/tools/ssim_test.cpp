// --ssim of weft compress and verify as a user asks for it.
#include "weft/metrics/ssim.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "support/memory_btf.hpp"
#include "support/temporary_folder.hpp"
#include "tools/weft_process.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/io/raw_btf.hpp"
#include "weft/reference/tile.hpp"

namespace weft::test {
namespace {

using nlohmann::json;

const BtfShape shape{3, 4, 12, 13, 3};

std::string write_raw(const std::string& path, const BtfShape& of, DType dtype) {
  const auto source = random_source(of, dtype, 3);
  std::vector<std::byte> bytes(source->info().bytes());
  source->read(0, of.images(), bytes);
  const auto sink = create_raw_btf(path, source->info());
  sink->write(0, of.images(), bytes);
  sink->finish();
  return path;
}

// The mean over images of model against raw, computed here.
double similarity_of(const std::string& raw_path, const std::string& model_path, double peak) {
  const auto raw = open_raw_btf(raw_path);
  const auto model = read_model(model_path);
  const auto decoder = find_codec(model->info.codec).reference_decoder(*model);
  std::vector<double> values(shape.image_values()), decoded(shape.image_values());
  SsimSums sums;
  for (std::size_t image = 0; image < shape.images(); ++image) {
    reference::read_tile(*raw, image, 1, false, values);
    decoder->decode(image, 1, decoded);
    sums.add(ssim(shape.height, shape.width, shape.channels, values, decoded, peak));
  }
  return sums.mean();
}

TEST(SsimOption, IsMeasuredRecordedAndVerified) {
  const TemporaryFolder folder;
  for (const DType dtype : {DType::u8, DType::f16, DType::f32}) {
    SCOPED_TRACE(name_of(dtype));
    const std::string raw = write_raw(folder / "raw.safetensors", shape, dtype);
    const std::string model = folder / "model.weft";
    const ProcessResult made =
        run_weft({"compress", raw, "--rank", "4", "--ssim", "--json", "-o", model});
    ASSERT_EQ(made.status, 0) << made.err;
    const json errors = json::parse(made.out).at("errors");
    const double found = errors.at("ssim").get<double>();
    // The device decodes in float: 1e-5 is far above its rounding and far below any other peak's
    // or window's result.
    EXPECT_NEAR(found, similarity_of(raw, model, errors.at("psnr_peak").get<double>()), 1e-5);
    EXPECT_LE(errors.at("lowest_ssim").get<double>(), found);
    EXPECT_GT(found, 0.2);
    EXPECT_LT(found, 0.99);

    const json info = json::parse(run_weft({"info", model, "--json"}).out);
    EXPECT_NE(info.dump().find(errors.at("ssim").dump()), std::string::npos);

    const ProcessResult verified =
        run_weft({"verify", model, "--against", raw, "--ssim", "--json"});
    ASSERT_EQ(verified.status, 0) << verified.err;
    const json rows = json::parse(verified.out).at("errors");
    ASSERT_EQ(rows.size(), 3u);
    EXPECT_EQ(rows[0].at("ssim"), errors.at("ssim"));
    EXPECT_NEAR(rows[1].at("ssim").get<double>(), found, 1e-5);
    EXPECT_EQ(rows[2].at("ssim"), errors.at("ssim"));
  }
}

TEST(SsimOption, OfTheReferenceAndOfAGivenPeak) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "raw.safetensors", shape, DType::f16);
  const std::string model = folder / "model.weft";
  const ProcessResult made = run_weft({"compress", raw, "--rank", "4", "--ssim", "--peak", "3",
                                       "--device", "reference", "--json", "-o", model});
  ASSERT_EQ(made.status, 0) << made.err;
  EXPECT_NEAR(json::parse(made.out).at("errors").at("ssim").get<double>(),
              similarity_of(raw, model, 3.0), 1e-12);
  const ProcessResult found = run_weft(
      {"compress", raw, "--rank", "4", "--ssim", "--device", "reference", "--json", "-o", model});
  const json errors = json::parse(found.out).at("errors");
  EXPECT_NEAR(errors.at("ssim").get<double>(),
              similarity_of(raw, model, errors.at("psnr_peak").get<double>()), 1e-12);
}

TEST(SsimOption, IsLeftOutWhereNobodyAsks) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "raw.safetensors", shape, DType::u8);
  const std::string model = folder / "model.weft";
  const ProcessResult made = run_weft({"compress", raw, "--rank", "4", "--json", "-o", model});
  EXPECT_FALSE(json::parse(made.out).at("errors").contains("ssim"));
  // verify can measure what was not recorded
  const ProcessResult verified = run_weft({"verify", model, "--against", raw, "--ssim", "--json"});
  ASSERT_EQ(verified.status, 0) << verified.err;
  EXPECT_TRUE(json::parse(verified.out).at("errors")[2].at("ssim").is_null());
}

TEST(SsimOption, RefusesImagesSmallerThanTheWindow) {
  const TemporaryFolder folder;
  const std::string raw = write_raw(folder / "raw.safetensors", {2, 2, 10, 16, 3}, DType::u8);
  const std::string model = folder / "model.weft";
  const ProcessResult refused = run_weft({"compress", raw, "--rank", "2", "--ssim", "-o", model});
  EXPECT_EQ(refused.status, 2);
  EXPECT_NE(refused.err.find("10 x 16"), std::string::npos) << refused.err;
  EXPECT_FALSE(std::filesystem::exists(model));
  ASSERT_EQ(run_weft({"compress", raw, "--rank", "2", "-o", model}).status, 0);
  EXPECT_EQ(run_weft({"verify", model, "--against", raw, "--ssim"}).status, 2);
  EXPECT_EQ(run_weft({"verify", model, "--ssim"}).status, 2);
}

}  // namespace
}  // namespace weft::test
