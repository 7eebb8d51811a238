// The codec `tucker` end to end, on the device and by the reference: exact recovery, errors against
// what the singular values say, monotony, goals, merged and long modes, bad requests.
#include "weft/codecs/tucker.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/model/file_sizer.hpp"
#include "weft/model/tucker.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft::test {
namespace {

using Tensor = std::vector<std::size_t>;

class Tucker : public testing::TestWithParam<bool> {
 protected:
  CodecRun run() const { return {"tucker", GetParam()}; }

  std::unique_ptr<Model> encode(TileSource& source, const Parameters& parameters,
                                Storage storage = Storage::f32) const {
    return run().encode(source, parameters, storage);
  }
  double error(TileSource& source, const Parameters& parameters,
               Storage storage = Storage::f32) const {
    return relative(run().measure(*encode(source, parameters, storage), source));
  }
};

INSTANTIATE_TEST_SUITE_P(Both, Tucker, testing::Bool(),
                         [](const auto& info) { return info.param ? "Device" : "Reference"; });

const TuckerModel& as_tucker(const Model& model) {
  return dynamic_cast<const TuckerModel&>(model);
}

double number(const Model& model, const char* name) {
  return nlohmann::json::parse(model.info.parameters).at(name).get<double>();
}

// [V][L][Y][X][C] of the given ranks, with singular values that fall by `decay` from one to the
// next in every mode.
std::vector<double> tensor_of_ranks(const BtfShape& shape, const std::array<std::size_t, 5>& ranks,
                                    double decay, std::uint64_t seed) {
  Tensor sizes(ranks.begin(), ranks.end());
  std::vector<double> T = random_values(reference::elements_of(sizes), seed, -1, 1);
  std::vector<std::size_t> index(5, 0);
  for (double& value : T) {
    std::size_t sum = 0;
    for (const std::size_t i : index) sum += i;
    value *= std::pow(decay, static_cast<double>(sum));
    for (std::size_t n = 5; n-- > 0;) {
      if (++index[n] < ranks[n]) break;
      index[n] = 0;
    }
  }
  for (const Mode mode : all_modes) {
    const std::size_t n = index_of(mode);
    const std::size_t size = mode_size(shape, mode);
    T = reference::mode_product(sizes, n, T, size, random_orthonormal(size, ranks[n], seed + n));
    sizes[n] = size;
  }
  return T;
}

constexpr BtfShape shape{12, 11, 14, 13, 3};

std::shared_ptr<MemorySource> decaying_source() {
  return source_of(shape, DType::f32, tensor_of_ranks(shape, {12, 11, 14, 13, 3}, 0.6, 3));
}

TEST_P(Tucker, RecoversGivenRanks) {
  const auto source = source_of(shape, DType::f32, tensor_of_ranks(shape, {4, 3, 5, 6, 2}, 0.7, 3));
  const Parameters ranks{{"ranks", "v=4,l=3,y=5,x=6,c=2"}};
  for (const char* method : {"hosvd", "sthosvd", "hooi"}) {
    Parameters parameters = ranks;
    parameters["method"] = method;
    // Five projections and back, each of less than 20 terms; float Gram matrices find the space to
    // within their rounding over the smallest singular value's part, 0.7^8 squared.
    EXPECT_LE(error(*source, parameters), 20 * 10 * 0x1p-24) << method;
  }
  for (const char* merge : {"yxc", "lc", "vl,yxc", "xc", "vlc,yx"}) {
    const ModeGroups groups(shape, merge);
    std::string text;
    for (const ModeGroup& group : groups.groups()) {
      std::size_t rank = 1;
      for (const Mode mode : group.modes) {
        rank *= std::array<std::size_t, 5>{4, 3, 5, 6, 2}[index_of(mode)];
      }
      text += (text.empty() ? "" : ",") + group.name + "=" + std::to_string(rank);
    }
    EXPECT_LE(error(*source, {{"merge", merge}, {"ranks", text}}), 60 * 10 * 0x1p-24) << merge;
  }
}

// The error is what the factors leave, and within the bounds of the singular values.
TEST_P(Tucker, ErrorsAreThoseOfTheSingularValues) {
  const auto source = decaying_source();
  for (const char* ranks : {"v=5,l=6,y=7,x=6", "v=3,x=2", "l=4", "v=6,l=6,y=6,x=6,c=2"}) {
    SCOPED_TRACE(ranks);
    const auto hosvd = encode(*source, {{"ranks", ranks}, {"method", "hosvd"}});
    const double measured = relative(run().measure(*hosvd, *source));
    // float factors are orthonormal to within some 1e-7, which the squares of errors feel
    EXPECT_NEAR(number(*hosvd, "factors_error"), measured, 1e-4 * measured);
    EXPECT_LE(measured, number(*hosvd, "error_bound") * (1 + 1e-5));
    const auto st = encode(*source, {{"ranks", ranks}});
    const double st_measured = relative(run().measure(*st, *source));
    EXPECT_NEAR(number(*st, "discarded"), st_measured, 1e-4 * st_measured);
    EXPECT_LE(st_measured, number(*hosvd, "error_bound") * (1 + 1e-5));
    // alternating from either start is no worse than the start
    for (const char* start : {"hosvd", "sthosvd"}) {
      const double hooi = error(
          *source, {{"ranks", ranks}, {"method", "hooi"}, {"start", start}, {"iterations", "2"}});
      EXPECT_LE(hooi, (start[0] == 'h' ? measured : st_measured) * (1 + 1e-5)) << start;
    }
  }
}

TEST_P(Tucker, ErrorFallsWithEveryRank) {
  const auto source = decaying_source();
  for (const char* mode : {"v", "l", "y", "x"}) {
    double before = 1;
    for (const std::size_t rank : Sizes{1, 3, 6, 10}) {
      const double found = error(*source, {{"ranks", mode + ("=" + std::to_string(rank))}});
      EXPECT_LT(found, before) << mode << " " << rank;
      before = found;
    }
  }
}

TEST_P(Tucker, TensorTexturesKeepsTexelsWhole) {
  const auto source = random_source(shape, DType::f16, 4);
  const auto model = encode(*source, {{"merge", "yxc"}, {"ranks", "v=5,l=4"}});
  const TuckerModel& tucker = as_tucker(*model);
  EXPECT_EQ(tucker.ranks, (Tensor{5, 4, shape.image_values()}));
  EXPECT_FALSE(tucker.has_factor(2));
  EXPECT_EQ(tucker.factors[0].size(), 12U * 5);
  // cutting one mode further leaves the other's factor as it is (strategic reduction)
  const auto less = encode(*source, {{"merge", "yxc"}, {"ranks", "v=5,l=3"}, {"method", "hosvd"}});
  const auto more = encode(*source, {{"merge", "yxc"}, {"ranks", "v=5,l=4"}, {"method", "hosvd"}});
  EXPECT_EQ(as_tucker(*less).factors[0], as_tucker(*more).factors[0]);
  for (std::size_t l = 0; l < shape.lights; ++l) {
    for (std::size_t r = 0; r < 3; ++r) {
      EXPECT_EQ(as_tucker(*less).factors[1][l * 3 + r], as_tucker(*more).factors[1][l * 4 + r]);
    }
  }
}

TEST_P(Tucker, RelativeErrorsAreMet) {
  for (const double decay : {0.35, 0.5}) {
    const auto source =
        source_of(shape, DType::f32, tensor_of_ranks(shape, {12, 11, 14, 13, 3}, decay, 6));
    for (const double wanted : {0.3, 0.1, 0.02, 0.002}) {
      for (const char* method : {"hosvd", "sthosvd", "hooi"}) {
        const auto model = run().meet(*source, fmt::format("rel={}", wanted), {{"method", method}});
        const double found = relative(run().measure(*model, *source));
        EXPECT_LE(found, wanted) << method;
        // one rank less of one mode would be too few, or nearly
        EXPECT_GE(found, wanted / 3) << method;
      }
    }
  }
}

TEST_P(Tucker, SizesAreMetAndUsed) {
  const auto source = decaying_source();
  for (const char* target : {"size=20KiB", "size=30KiB", "ratio=12"}) {
    const auto model = run().meet(*source, target);
    const std::size_t most = target[0] == 'r'   ? source->info().bytes() / 12
                             : target[5] == '2' ? std::size_t{20} << 10
                                                : std::size_t{30} << 10;
    EXPECT_LE(model_file_size(*model), most) << target;
    EXPECT_GE(model_file_size(*model), most * 8 / 10) << target;
  }
  expect_error(ErrorKind::unmet_goal, {"--target size=1KiB"},
               [&] { run().meet(*source, "size=1KiB"); });
}

// At the size of ranks in equal proportion to the modes, with the measured errors in the file,
// chosen ranks are no worse. They are a part of a larger fit, which may differ from a fit at those
// ranks by a part of a thousand.
TEST_P(Tucker, ChosenRanksAreNoWorseThanEqualProportions) {
  for (const std::array<std::size_t, 5>& ranks :
       {std::array<std::size_t, 5>{12, 11, 14, 13, 3}, {5, 11, 14, 4, 3}, {12, 3, 5, 13, 1}}) {
    const auto source = source_of(shape, DType::f32, tensor_of_ranks(shape, ranks, 0.75, 8));
    for (const double part : {0.35, 0.5, 0.7}) {
      std::string text;
      for (const Mode mode : {Mode::view, Mode::light, Mode::row, Mode::column}) {
        const double rank = std::round(part * static_cast<double>(mode_size(shape, mode)));
        text += fmt::format("{}{}={}", text.empty() ? "" : ",", name_of(mode), rank);
      }
      const auto equal = run().encode(*source, {{"ranks", text}}, Storage::f16);
      const auto chosen =
          run().meet(*source, fmt::format("size={}", FileSizer().size_with_errors(*equal) + 64));
      EXPECT_LE(relative(run().measure(*chosen, *source)),
                relative(run().measure(*equal, *source)) * (1 + 1e-3))
          << text;
    }
  }
}

TEST_P(Tucker, BadRequestsAreNamed) {
  const auto source = random_source(shape, DType::f16, 4);
  const auto refused = [&](const Parameters& parameters,
                           std::initializer_list<std::string_view> parts) {
    expect_error(ErrorKind::input, parts, [&] { encode(*source, parameters); });
  };
  refused({{"ranks", "v=13"}}, {"--ranks v=13", "13", "12", "mode v"});
  refused({{"ranks", "v=0"}}, {"--ranks v=0"});
  refused({{"ranks", "v"}}, {"--ranks v"});
  refused({{"ranks", "v=2,"}}, {"--ranks v=2,"});
  refused({{"ranks", "v=2,v=3"}}, {"twice"});
  refused({{"ranks", "c=2"}, {"merge", "yxc"}}, {"'c'", "v, l, yxc"});
  refused({{"merge", "vy"}}, {"--merge vy"});
  refused({{"method", "svd"}}, {"--method svd"});
  refused({{"start", "hooi"}}, {"--start hooi"});
  refused({{"iterations", "-1"}}, {"--iterations -1"});
  refused({{"arithmetic", "f16"}}, {"--arithmetic f16"});
  EXPECT_EQ(source->images_read(), 0U);
  expect_error(ErrorKind::unmet_goal, {"--target rel=1e-8", "float factors"},
               [&] { run().meet(*source, "rel=1e-8"); });
  // ranks that do not reach the goal
  expect_error(ErrorKind::unmet_goal, {"--target rel=0.1", "v=2,x=3"}, [&] {
    run().meet(*source, "rel=0.1", {{"ranks", "v=2,x=3"}});
  });
}

// Whatever a size cut last.
TEST_P(Tucker, ModelsSayTheRanksThatTheyHave) {
  const auto source = random_source(shape, DType::f16, 4);
  for (const char* target : {"size=8KiB", "size=12KiB", "size=20000", "size=31234"}) {
    const auto model = run().meet(*source, target, {}, Storage::f32);
    const auto said = nlohmann::json::parse(model->info.parameters).at("ranks");
    const TuckerModel& tucker = as_tucker(*model);
    for (std::size_t n = 0; n < tucker.ranks.size(); ++n) {
      EXPECT_EQ(said.at(tucker.groups.groups()[n].name).get<std::size_t>(), tucker.ranks[n])
          << target;
    }
  }
}

TEST_P(Tucker, ZerosHaveAGoalToo) {
  const auto source = source_of(shape, DType::f16, std::vector<double>(shape.values(), 0.0));
  for (const char* target : {"rel=0.1", "size=20KiB"}) {
    const auto model = run().meet(*source, target);
    EXPECT_EQ(run().measure(*model, *source).max_difference, 0) << target;
  }
}

// Beyond 4096 a mode has no Gram matrix: rank V L holds all there is.
TEST(TuckerDevice, LongModes) {
  const BtfShape long_texels{4, 5, 48, 40, 3};  // yxc is 5760, yx 1920
  const CodecRun run{"tucker", true};
  const auto source = random_source(long_texels, DType::f16, 4);
  const auto error = [&](const Parameters& parameters) {
    return relative(run.measure(*run.encode(*source, parameters, Storage::f32), *source));
  };
  EXPECT_LE(error({{"merge", "yxc"}, {"ranks", "yxc=20"}}), 1e-5);
  EXPECT_LE(error({{"merge", "yxc"}, {"ranks", "v=3,yxc=20"}}),
            error({{"merge", "yxc"}, {"ranks", "v=3"}}) * (1 + 1e-4));
  const double ten = error({{"merge", "yxc"}, {"ranks", "yxc=10"}});
  EXPECT_GT(ten, 0.1);
  // the best of rank 10: an SVD of the images
  const std::vector<double> images = decode_values(source->bytes(), DType::f16);
  const reference::SymmetricEigen eigen = reference::symmetric_eigen(
      20, reference::mode_gram(Tensor{20, long_texels.image_values()}, 0, images));
  double left = 0;
  double all = 0;
  for (std::size_t i = 0; i < 20; ++i) {
    all += eigen.values[i];
    if (i >= 10) left += eigen.values[i];
  }
  EXPECT_NEAR(ten, std::sqrt(left / all), 0.02 * ten);
  // with hosvd and hooi, and on the side of directions
  EXPECT_LE(error({{"merge", "yxc"}, {"ranks", "l=3,yxc=12"}, {"method", "hooi"}}),
            error({{"merge", "yxc"}, {"ranks", "l=3,yxc=12"}, {"method", "hosvd"}}) * (1 + 1e-3));
  const BtfShape long_views{70, 61, 3, 4, 1};  // vl is 4270
  const auto views = random_source(long_views, DType::f16, 4);
  EXPECT_LE(relative(run.measure(
                *run.encode(*views, {{"merge", "vl"}, {"ranks", "vl=12"}}, Storage::f32), *views)),
            1e-5);
  expect_error(ErrorKind::input, {"mode y", "4096"}, [&] {
    const auto tall = random_source({1, 2, 5000, 2, 1}, DType::f16, 4);
    run.encode(*tall, {{"ranks", "y=3"}}, Storage::f32);
  });
}

// Several blocks of texels and runs of images, from mapped and read sources alike.
TEST(TuckerDevice, SeveralTilesOfEitherKind) {
  const BtfShape large{40, 50, 24, 23, 2};  // blocks of 524 texels, runs of 96 images
  const auto bytes = encode_values(tensor_of_ranks(large, {4, 3, 5, 6, 2}, 0.8, 3), DType::f32);
  MemorySource mapped(make_info(large), bytes, true);
  MemorySource read(make_info(large), bytes, false);
  const CodecRun run{"tucker", true};
  for (const Parameters& parameters :
       {Parameters{{"ranks", "v=4,l=3,y=5,x=6"}, {"method", "hosvd"}},
        Parameters{{"ranks", "v=4,l=3,y=5,x=6"}},
        Parameters{{"ranks", "v=4,l=3,y=5,x=6"}, {"method", "hooi"}, {"iterations", "1"}},
        Parameters{{"merge", "yxc"}, {"ranks", "v=4,l=3"}},
        Parameters{{"merge", "lc"}, {"ranks", "v=4,lc=6"}}, Parameters{{"ranks", "y=5,x=6,c=2"}}}) {
    const auto model = run.encode(mapped, parameters, Storage::f32);
    // as in RecoversGivenRanks
    EXPECT_LE(relative(run.measure(*model, mapped)), 60 * 10 * 0x1p-24);
    const auto again = run.encode(read, parameters, Storage::f32);
    EXPECT_EQ(as_tucker(*model).core, as_tucker(*again).core);
    EXPECT_EQ(as_tucker(*model).factors, as_tucker(*again).factors);
  }
}

// What memory does not hold is held in a file, with the same bits.
TEST(TuckerDevice, TheSameBitsFromAFile) {
  const BtfShape large{40, 50, 24, 23, 2};
  const auto source =
      source_of(large, DType::f32, tensor_of_ranks(large, {20, 20, 20, 20, 2}, 0.8, 3));
  const CodecRun run{"tucker", true};
  for (const char* method : {"sthosvd", "hosvd", "hooi"}) {
    const Parameters parameters{
        {"ranks", "v=9,l=8,y=7,x=6"}, {"method", method}, {"iterations", "1"}};
    Job ample;
    std::size_t working = 0;
    ample.on_plan = [&](const MemoryPlan& plan) {
      for (const MemoryItem& item : plan.items) {
        if (item.what != "projected tensor") working += item.bytes;
      }
    };
    const auto held = run.encode(*source, parameters, Storage::f32, ample);
    Job scarce;
    scarce.memory = working;
    const auto filed = run.encode(*source, parameters, Storage::f32, scarce);
    EXPECT_EQ(as_tucker(*held).core.place(), FloatStore::Place::memory) << method;
    EXPECT_EQ(as_tucker(*filed).core.place(), FloatStore::Place::file) << method;
    EXPECT_EQ(as_tucker(*held).core, as_tucker(*filed).core) << method;
    EXPECT_EQ(as_tucker(*held).factors, as_tucker(*filed).factors) << method;
    // and it is decoded alike
    EXPECT_EQ(run.decode(*held, 7), run.decode(*filed, 7)) << method;
  }
}

}  // namespace
}  // namespace weft::test
