// The codecs `kcta` and `cta` end to end, on the device and by the reference: exact recovery, what
// they have in common with each other and with tucker, errors that never grow, the clustering stage
// against full reconstructions, extremes, bad requests.
#include "weft/codecs/kcta.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "codecs/codec_runs.hpp"
#include "support/expect_error.hpp"
#include "support/generators.hpp"
#include "support/matchers.hpp"
#include "support/memory_btf.hpp"
#include "weft/btf/view_grid.hpp"
#include "weft/codecs/fit_kcta.hpp"
#include "weft/codecs/mix_slices.hpp"
#include "weft/model/kcta.hpp"
#include "weft/reference/factorise.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft::test {
namespace {

class Kcta : public testing::TestWithParam<bool> {
 protected:
  std::unique_ptr<Model> encode(TileSource& source, const Parameters& parameters,
                                const char* codec = "kcta", Storage storage = Storage::f32) const {
    return CodecRun{codec, GetParam()}.encode(source, parameters, storage);
  }
  double error(TileSource& source, const Parameters& parameters, const char* codec = "kcta") const {
    return relative(
        CodecRun{codec, GetParam()}.measure(*encode(source, parameters, codec), source));
  }
};

INSTANTIATE_TEST_SUITE_P(Both, Kcta, testing::Bool(),
                         [](const auto& info) { return info.param ? "Device" : "Reference"; });

const KctaModel& as_kcta(const Model& model) {
  return dynamic_cast<const KctaModel&>(model);
}

constexpr BtfShape shape{14, 5, 9, 8, 3};
constexpr std::size_t groups_of_views = 3;

// Views of `groups` clusters, each in a space of rank `views` x `rows` x `columns` of its own
// without noise; view v is a mixture of `mixed` of them from v % groups on.
std::vector<double> clustered_tensor(std::size_t views, std::size_t rows, std::size_t columns,
                                     std::size_t mixed, std::uint64_t seed) {
  const std::size_t directions = shape.lights * shape.channels;
  std::vector<double> tensor(shape.values(), 0.0);  // [V][L C][Y][X], turned below
  const std::size_t image = directions * shape.texels();
  for (std::size_t g = 0; g < groups_of_views; ++g) {
    Sizes sizes{views, directions, rows, columns};
    std::vector<double> core = random_values(reference::elements_of(sizes), seed + g, -1, 1);
    core = reference::mode_product(sizes, 2, core, shape.height,
                                   random_orthonormal(shape.height, rows, seed + 10 + g));
    sizes[2] = shape.height;
    core = reference::mode_product(sizes, 3, core, shape.width,
                                   random_orthonormal(shape.width, columns, seed + 20 + g));
    Random random(seed + 30 + g);
    for (std::size_t v = 0; v < shape.views; ++v) {
      const std::size_t place = (g + groups_of_views - v % groups_of_views) % groups_of_views;
      if (place >= mixed) continue;
      for (std::size_t r = 0; r < views; ++r) {
        const double u = random.normal();
        for (std::size_t i = 0; i < image; ++i) tensor[v * image + i] += u * core[r * image + i];
      }
    }
  }
  std::vector<double> stored(tensor.size());
  for (std::size_t i = 0; i < tensor.size(); ++i) {
    const std::size_t p = i % shape.texels();
    const std::size_t c = i / shape.texels() % shape.channels;
    const std::size_t n = i / shape.texels() / shape.channels;
    stored[(n * shape.texels() + p) * shape.channels + c] = tensor[i];
  }
  return stored;
}

Parameters clustered(std::size_t clusters, std::size_t mixtures, const char* ranks,
                     const char* init = "slices") {
  return {{"clusters", std::to_string(clusters)},
          {"mixtures", std::to_string(mixtures)},
          {"ranks", ranks},
          {"rank", "100"},
          {"init", init}};
}

Parameters without(Parameters parameters, const char* name) {
  parameters.erase(name);
  return parameters;
}

// Data that are clusters of these ranks come back: two projections and back of fewer than 20 terms
// each, and mixtures of as many.
TEST_P(Kcta, RecoversClusteredData) {
  const auto source = source_of(shape, DType::f32, clustered_tensor(2, 3, 4, 1, 5));
  const Parameters asked = clustered(3, 1, "v=2,y=3,x=4");
  EXPECT_LE(error(*source, asked), 40 * 10 * 0x1p-24);
  EXPECT_LE(error(*source, without(asked, "mixtures"), "cta"), 40 * 10 * 0x1p-24);
  // every view is in the cluster of the views that were made with it
  const auto model = encode(*source, asked);
  const KctaModel& kcta = as_kcta(*model);
  for (std::size_t v = 0; v < shape.views; ++v) {
    EXPECT_EQ(kcta.members[v], kcta.members[v % groups_of_views]);
  }
}

TEST_P(Kcta, MixturesOfClustersTakeMixtures) {
  const auto source = source_of(shape, DType::f32, clustered_tensor(1, 2, 2, 2, 5));
  const double hard = error(*source, clustered(3, 1, "v=1,y=2,x=2"));
  const double soft = error(*source, clustered(3, 2, "v=1,y=2,x=2"));
  EXPECT_GT(hard, 0.1);
  EXPECT_LT(soft, hard / 2);
}

// One cluster is a Tucker decomposition by alternating least squares, whatever the mixtures.
TEST_P(Kcta, OneClusterIsTucker) {
  const auto source = random_source(shape, DType::f16, 4);
  const char* ranks = "v=4,lc=6,y=5,x=4";
  const auto tucker = CodecRun{"tucker", GetParam()}.encode(
      *source, {{"merge", "lc"}, {"ranks", ranks}, {"method", "hooi"}, {"iterations", "20"}},
      Storage::f32);
  const double expected = relative(CodecRun{"tucker", GetParam()}.measure(*tucker, *source));
  for (const char* global : {"none", "lc"}) {
    const double found = error(*source, {{"clusters", "1"},
                                         {"mixtures", "1"},
                                         {"ranks", ranks},
                                         {"global", global},
                                         {"iterations", "20"}});
    // a global basis is not iterated; both stop a little before their limits
    const bool iterated = global[0] == 'n';
    EXPECT_GE(found, expected * (1 - 2e-3)) << global;
    EXPECT_LE(found, expected * (iterated ? 1 + 2e-3 : 1 + 2e-2)) << global;
  }
}

// Section 4.1.2: with K = 1 the same results.
TEST_P(Kcta, OneMixtureIsCta) {
  const auto source = random_source(shape, DType::f16, 4);
  for (const char* init : {"directions", "slices", "random"}) {
    const Parameters asked = clustered(4, 1, "v=2,y=4,x=4", init);
    const auto kcta = encode(*source, asked);
    const auto cta = encode(*source, without(asked, "mixtures"), "cta");
    EXPECT_EQ(tensor_bytes(*kcta), tensor_bytes(*cta)) << init;
    EXPECT_EQ(cta->info.codec, "cta");
  }
}

KctaErrors errors_of(TileSource& source, std::size_t clusters, std::size_t mixtures,
                     bool on_device) {
  KctaRequest request;
  request.groups = ModeGroups(source.info().shape, "lc");
  request.mode = request.groups.find("v", "");
  request.global_mode = {0, 1, 0, 0};
  request.ranks = {2, 6, 4, 4};
  request.clusters = clusters;
  request.mixtures = mixtures;
  request.least_change = 0;
  request.iterations = 40;
  Job job;
  return (on_device ? fit_kcta(shared_device(), source, request, job)
                    : reference::encode_kcta(source, request, job))
      .errors;
}

// Section 5.3, and device against reference step by step.
TEST_P(Kcta, ErrorsNeverGrow) {
  bool restored = false;
  for (const std::uint64_t seed : {7, 8, 9, 10}) {
    const auto source = random_source(shape, DType::f16, seed);
    for (std::size_t mixtures = 1; mixtures <= 3; ++mixtures) {
      const KctaErrors found = errors_of(*source, 5, mixtures, GetParam());
      const std::vector<double>& errors = found.history;
      restored = restored || found.restored;
      ASSERT_GE(errors.size(), 2U);
      for (std::size_t i = 1; i < errors.size(); ++i) EXPECT_LE(errors[i], errors[i - 1]);
      if (seed > 7) continue;
      const std::vector<double> others = errors_of(*source, 5, mixtures, !GetParam()).history;
      // float products of up to 4096 terms, before choices can differ
      EXPECT_NEAR(errors[0], others[0], 1e-4 * others[0]);
      EXPECT_NEAR(errors.back(), others.back(), 0.02 * others.back());
    }
  }
  EXPECT_TRUE(restored);  // or nothing of it was tried
}

TEST_P(Kcta, MoreMixturesAreNoWorse) {
  const auto source = source_of(shape, DType::f32, clustered_tensor(2, 4, 4, 2, 9));
  double before = 1;
  for (std::size_t mixtures = 1; mixtures <= 3; ++mixtures) {
    const double found = error(*source, clustered(4, mixtures, "v=1,y=4,x=4"));
    EXPECT_LE(found, before * (1 + 1e-3)) << mixtures;
    before = found;
  }
}

// Whichever mode is clustered, and whatever is merged, global or whole.
TEST_P(Kcta, AnyModeIsClustered) {
  const auto source = random_source(shape, DType::f16, 4);
  const Parameters asked[] = {
      {{"mode", "v"}, {"merge", "none"}, {"ranks", "v=2,l=4,y=5"}},
      {{"mode", "l"}, {"merge", "none"}, {"ranks", "v=4,l=1,y=5,x=6"}},
      {{"mode", "lc"}, {"ranks", "lc=3,v=6"}, {"global", "v"}},
      {{"mode", "x"}, {"ranks", "x=2,v=9,y=7"}},
      {{"mode", "y"}, {"global", "none"}, {"ranks", "y=2,v=9,lc=7"}},
      {{"mode", "v"}, {"merge", "yxc"}, {"ranks", "v=2,l=3,yxc=30"}, {"global", "l,yxc"}},
      {{"mode", "yx"}, {"merge", "yx"}, {"ranks", "yx=6,l=3"}},
      {{"mode", "vl"}, {"merge", "vl"}, {"ranks", "vl=4,y=5"}}};
  for (Parameters parameters : asked) {
    SCOPED_TRACE(parameters.at("mode") + " " + parameters.at("ranks"));
    parameters["clusters"] = "3";
    parameters["mixtures"] = "2";
    parameters["rank"] = "100";
    const auto model = encode(*source, parameters);
    // it decodes to what its encoder found
    const double said = nlohmann::json::parse(model->info.parameters).at("factors_error");
    const CodecRun run{"kcta", GetParam()};
    EXPECT_NEAR(relative(run.measure(*model, *source)), said, 1e-4);
    EXPECT_LT(said, 0.5);
    // and alike on either side
    const CodecRun other{"kcta", !GetParam()};
    EXPECT_TRUE(all_near(run.decode(*model, 9), other.decode(*model, 9),
                         run.get().decode_tolerance(*model)));
  }
}

TEST_P(Kcta, EqualAndEmptySlices) {
  for (const double constant : {0.0, 0.5}) {
    const auto source = source_of(shape, DType::f32, std::vector<double>(shape.values(), constant));
    for (const char* init : {"directions", "slices", "random"}) {
      const auto model = encode(*source, clustered(6, 3, "v=2,y=2,x=2", init));
      EXPECT_LE(CodecRun({"kcta", GetParam()}).measure(*model, *source).max_difference,
                constant * 0x1p-24 * 5 * 40);
    }
  }
  // as many clusters as slices, each of more ranks than slices
  const auto source = random_source(shape, DType::f16, 4);
  EXPECT_LE(error(*source, clustered(14, 1, "v=3")), 1e-5);
  EXPECT_LE(error(*source, clustered(14, 14, "v=1")), 1e-5);
}

// Section 6: each rank by its own mode, clusters by the rank of theirs.
TEST_P(Kcta, RanksAreChosen) {
  const auto source = source_of(shape, DType::f32, clustered_tensor(2, 2, 1, 1, 5));
  const auto choose = [&](Parameters parameters) {
    parameters["threshold"] = "0.01";
    const auto model = encode(*source, parameters);
    const KctaModel& kcta = as_kcta(*model);
    return std::pair(kcta.ranks, kcta.clusters);
  };
  // three clusters of 2 views, 2 rows and 1 column each, all 15 lights and channels
  EXPECT_EQ(choose({{"ranks", "v=2"}}), std::pair(Sizes{2, 12, 6, 3}, std::size_t{3}));
  EXPECT_EQ(choose({{"align", "4"}}), std::pair(Sizes{4, 12, 8, 4}, std::size_t{2}));
  EXPECT_EQ(choose({{"ranks", "v=3,y=2"}, {"clusters", "4"}}),
            std::pair(Sizes{3, 12, 2, 3}, std::size_t{4}));
}

// Of a model that loses nothing, views of the grid are what is interpolated of the measured ones.
TEST_P(Kcta, GridsOfViewsInterpolateTheMeasuredOnes) {
  const auto source = random_source(shape, DType::f16, 4);
  const std::vector<double> values = decode_values(source->bytes(), DType::f16);
  // both clusters together span all views
  const auto model = encode(*source, {{"clusters", "2"},
                                      {"mixtures", "2"},
                                      {"ranks", "v=14"},
                                      {"rank", "100"},
                                      {"iterations", "0"},
                                      {"init", "random"},
                                      {"resample-views", "7"}});
  ASSERT_EQ(model->view_grid(), 7U);
  const ViewResampling views(source->info().view_directions, 7);
  for (std::size_t e = 0; e < views.size(); ++e) {
    const std::vector<double> w = views.weights(e);
    std::vector<double> expected(3, 0.0);
    for (std::size_t v = 0; v < shape.views; ++v) {
      for (std::size_t c = 0; c < 3; ++c) {
        expected[c] += w[v] * values[((v * 5 + 3) * 72 + 6 * 8 + 5) * 3 + c];
      }
    }
    std::vector<double> found(3);
    model->decode_texel(shape.views + e, 3, 6, 5, found);
    EXPECT_TRUE(all_near(found, expected, 1e-4)) << e;
  }
}

// Products of rows say of a grid what slices that are interpolated do; and the samplers look up
// what the model decodes to.
TEST(KctaDevice, GridsOfViewsAreThoseOfTheReference) {
  const auto source = source_of(shape, DType::f32, clustered_tensor(2, 3, 4, 2, 5));
  Parameters asked = clustered(3, 2, "v=2,y=3,x=4");
  asked["resample-views"] = "9";
  const auto found = CodecRun{"kcta", true}.encode(*source, asked, Storage::f32);
  const auto expected = CodecRun{"kcta", false}.encode(*source, asked, Storage::f32);
  const std::size_t views = shape.views + 81;
  std::vector<std::uint32_t> records;
  std::vector<double> of_device;
  std::vector<double> of_reference;
  double largest = 0;
  for (std::size_t v = 0; v < views; ++v) {
    std::vector<double> one(3), other(3);
    found->decode_texel(v, v % 5, v % 9, v % 8, one);
    expected->decode_texel(v, v % 5, v % 9, v % 8, other);
    of_device.insert(of_device.end(), one.begin(), one.end());
    of_reference.insert(of_reference.end(), other.begin(), other.end());
    for (const double value : other) largest = std::max(largest, std::abs(value));
    records.insert(records.end(),
                   {static_cast<std::uint32_t>(v % 9 * 8 + v % 8), static_cast<std::uint32_t>(v),
                    static_cast<std::uint32_t>(v % 5)});
  }
  // both end near the same minimum; a greedy choice that rounding decides is none of these
  EXPECT_TRUE(all_near(of_device, of_reference, 1e-3 * largest));

  Device& device = shared_device();
  const Codec& codec = find_codec("kcta");
  Buffer lookups(device, records.size() * sizeof(std::uint32_t), "look-ups");
  Buffer out(device, views * 3 * sizeof(float), "values");
  device.write(lookups, std::span<const std::uint32_t>(records));
  codec.sampler(device, *found)->look_up({1, 1, 1}, views, lookups, out);
  std::vector<float> values(views * 3);
  device.read(out, std::span<float>(values));
  EXPECT_TRUE(all_near(values, of_device, lookup_tolerance(codec, *found, {1, 1, 1})));
}

TEST_P(Kcta, BadRequestsAreNamed) {
  const auto source = random_source(shape, DType::f16, 4);
  const auto refused = [&](const Parameters& parameters,
                           std::initializer_list<std::string_view> parts) {
    expect_error(ErrorKind::input, parts, [&] { encode(*source, parameters); });
  };
  refused({{"clusters", "15"}}, {"--clusters 15", "mode v", "14"});
  refused({{"clusters", "0"}}, {"--clusters 0"});
  refused({{"clusters", "4"}, {"mixtures", "5"}}, {"--mixtures 5", "4 clusters"});
  refused({{"mixtures", "0"}}, {"--mixtures 0"});
  refused({{"mode", "l"}}, {"--mode l", "v, lc, y, x"});
  refused({{"ranks", "y=10"}}, {"--ranks y=10", "mode y", "9"});
  refused({{"ranks", "v=0"}}, {"--ranks v=0"});
  refused({{"global", "v"}}, {"--global v", "clusters"});
  refused({{"global", "lc,lc"}}, {"--global lc,lc", "twice"});
  refused({{"global", "q"}}, {"--global q"});
  refused({{"global", "y,"}}, {"--global y,"});
  refused({{"init", "best"}}, {"--init best"});
  refused({{"iterations", "-1"}}, {"--iterations -1"});
  refused({{"resample-views", "1025"}}, {"--resample-views 1025", "1024"});
  refused({{"resample-views", "-1"}}, {"--resample-views -1"});
  refused({{"resample-views", "4"}, {"mode", "lc"}}, {"--resample-views 4", "mode lc"});
  refused({{"threshold", "1"}}, {"--threshold 1"});
  refused({{"threshold", "x"}}, {"--threshold x"});
  refused({{"threshold", "0.1"}, {"align", "0"}}, {"--align 0"});
  refused({{"merge", "vy"}}, {"--merge vy"});
  EXPECT_EQ(source->images_read(), 0U);
  const auto long_mode = random_source({2, 1, 5000, 1, 1}, DType::f16, 4);
  expect_error(ErrorKind::input, {"--mode", "mode y", "4096"}, [&] {
    encode(*long_mode, {{"mode", "y"}});
  });
  expect_error(ErrorKind::input, {"--ranks", "mode y", "4096"}, [&] { encode(*long_mode, {}); });
}

// What memory does not hold is held in files, with the same bits.
TEST(KctaDevice, TheSameBitsFromAFile) {
  const BtfShape large{20, 24, 40, 40, 2};
  const auto source = random_source(large, DType::f16, 4);
  const CodecRun run{"kcta", true};
  const Parameters asked{{"clusters", "3"},
                         {"mixtures", "2"},
                         {"ranks", "v=3,y=10,x=12"},
                         {"rank", "100"},
                         {"iterations", "1"}};
  Job ample;
  std::size_t working = 0;
  ample.on_plan = [&](const MemoryPlan& plan) {
    for (const MemoryItem& item : plan.items) {
      if (item.what != "slices" && item.what != "slices of clusters") working += item.bytes;
    }
  };
  const auto held = run.encode(*source, asked, Storage::f32, ample);
  Job scarce;
  scarce.memory = std::max(working, std::size_t{150} << 20);
  const auto filed = run.encode(*source, asked, Storage::f32, scarce);
  EXPECT_EQ(tensor_bytes(*held), tensor_bytes(*filed));
}

// --- the clustering stage ---

struct Stage {
  Sizes sizes{9, 4, 5, 6};  // the clustered mode first
  std::vector<double> A;
  std::vector<reference::KctaCluster> clusters;
  std::size_t row = 120;

  explicit Stage(std::size_t count) : A(random_values(9 * 120, 3, -1, 1)) {
    for (std::size_t c = 0; c < count; ++c) {
      reference::KctaCluster cluster;
      cluster.sizes = {2, 4, 3, 4};
      cluster.Z = random_values(2 * 48, 40 + c, -1, 1);
      cluster.U = {{}, random_orthonormal(5, 3, 50 + c), random_orthonormal(6, 4, 60 + c)};
      clusters.push_back(std::move(cluster));
    }
  }
  // What is left of a slice after its projection onto the rows of some clusters, squared, from full
  // reconstructions.
  double left(std::size_t slice, std::span<const std::size_t> chosen) const {
    std::vector<double> rows;
    for (const std::size_t c : chosen) {
      const std::vector<double> more = clusters[c].rows();
      rows.insert(rows.end(), more.begin(), more.end());
    }
    const std::size_t count = rows.size() / row;
    reference::Orthonormal basis;
    if (count > 0) {
      basis =
          reference::orthonormal_basis(row, count, reference::transposed(count, row, rows), 1e-12);
    }
    const std::vector<double> a(A.begin() + static_cast<std::ptrdiff_t>(slice * row),
                                A.begin() + static_cast<std::ptrdiff_t>((slice + 1) * row));
    double squares = std::inner_product(a.begin(), a.end(), a.begin(), 0.0);
    for (std::size_t r = 0; r < basis.rank; ++r) {
      double dot = 0;
      for (std::size_t i = 0; i < row; ++i) dot += a[i] * basis.Q[i * basis.rank + r];
      squares -= dot * dot;
    }
    return squares;
  }
};

// The reduced space says of each slice what full reconstructions say; with one cluster for each the
// search is brute force, with more it is no better than that.
TEST(KctaStage, GreedySearchInTheReducedSpace) {
  constexpr std::size_t count = 5;
  const Stage stage(count);
  for (const std::size_t mixtures : Sizes{1, 2, 3}) {
    const reference::KctaMixing mixing =
        reference::mix_slices(stage.sizes, stage.A, stage.clusters, mixtures);
    for (std::size_t i = 0; i < 9; ++i) {
      const auto own = std::span(mixing.members).subspan(i * mixtures, mixtures);
      EXPECT_TRUE(std::is_sorted(own.begin(), own.end()));
      const Sizes chosen(own.begin(), own.end());
      EXPECT_NEAR(mixing.errors[i], stage.left(i, chosen), 1e-9);
      double best = std::numeric_limits<double>::infinity();
      for (unsigned set = 1; set < 1U << count; ++set) {
        Sizes subset;
        for (std::size_t c = 0; c < count; ++c) {
          if ((set >> c & 1U) != 0) subset.push_back(c);
        }
        if (subset.size() == mixtures) best = std::min(best, stage.left(i, subset));
      }
      EXPECT_GE(mixing.errors[i], best - 1e-9);
      if (mixtures == 1) {
        EXPECT_NEAR(mixing.errors[i], best, 1e-9);
      }
      // the coefficients are those of the projection
      double squares = 0;
      std::vector<double> residual(
          stage.A.begin() + static_cast<std::ptrdiff_t>(i * stage.row),
          stage.A.begin() + static_cast<std::ptrdiff_t>((i + 1) * stage.row));
      for (std::size_t k = 0; k < mixtures; ++k) {
        const std::vector<double> rows = stage.clusters[own[k]].rows();
        for (std::size_t r = 0; r < 2; ++r) {
          const double u = mixing.coefficients[(i * mixtures + k) * 2 + r];
          for (std::size_t p = 0; p < stage.row; ++p) residual[p] -= u * rows[r * stage.row + p];
        }
      }
      for (const double value : residual) squares += value * value;
      EXPECT_NEAR(squares, mixing.errors[i], 1e-9);
    }
  }
}

// The same from products of rows, as the device has them; of cores that are rank-deficient, too,
// and of clusters that are the same.
TEST(KctaStage, ProductsOfRowsSayTheSame) {
  for (const bool degenerate : {false, true}) {
    Stage stage(5);
    if (degenerate) {
      std::copy_n(stage.clusters[1].Z.begin(), 48, stage.clusters[1].Z.begin() + 48);
      std::fill(stage.clusters[3].Z.begin(), stage.clusters[3].Z.end(), 0.0);
      stage.clusters[4] = stage.clusters[2];
    }
    std::vector<double> B;
    for (const reference::KctaCluster& cluster : stage.clusters) {
      const std::vector<double> rows = cluster.rows();
      B.insert(B.end(), rows.begin(), rows.end());
    }
    const Sizes of_slices{9, stage.row};
    const Sizes of_rows{10, stage.row};
    const std::vector<double> products = reference::mode_product(of_slices, 1, stage.A, 10, B);
    const std::vector<double> gram = reference::mode_gram(of_rows, 0, B);
    std::vector<double> squares;
    for (std::size_t i = 0; i < 9; ++i) squares.push_back(stage.left(i, {}));
    for (const std::size_t mixtures : Sizes{1, 2, 3}) {
      const auto expected = reference::mix_slices(stage.sizes, stage.A, stage.clusters, mixtures);
      const auto found = mix_by_products(5, mixtures, products, gram, squares);
      EXPECT_TRUE(all_near(found.errors, expected.errors, 1e-8));
      if (degenerate) continue;  // of clusters that are the same, rounding takes either
      EXPECT_EQ(found.members, expected.members);
      EXPECT_TRUE(all_near(found.coefficients, expected.coefficients, 1e-6));
    }
  }
}

TEST(KctaStage, EmptyClustersTakeTheWorseHalfOfTheWorst) {
  //                         slice  0  1  2  3  4  5
  std::vector<std::uint32_t> members{0, 0, 2, 0, 2, 0};
  const std::vector<double> errors{1, 5, 3, 4, 2, 1};
  const auto moves = fill_empty_clusters(4, 1, members, errors);
  // cluster 0 (11) gives slices 1 and 3 to cluster 1, which (9) gives slice 1 on to cluster 3
  EXPECT_EQ(members, (std::vector<std::uint32_t>{0, 3, 2, 1, 2, 0}));
  ASSERT_EQ(moves.size(), 3U);
  EXPECT_EQ(moves[2].slice, 1U);
  EXPECT_EQ(moves[2].from, 1U);
  EXPECT_EQ(moves[2].to, 3U);
  // of several clusters for each slice, one goes
  std::vector<std::uint32_t> pairs{0, 1, 0, 1, 0, 1};
  fill_empty_clusters(3, 2, pairs, std::vector<double>{1, 3, 2});
  EXPECT_EQ(pairs, (std::vector<std::uint32_t>{0, 1, 2, 1, 0, 1}));
}

TEST(KctaStage, StartsFillAllClusters) {
  const BtfInfo info = make_info({40, 7, 3, 5, 3});
  const ModeGroups groups(info.shape, "lc");
  for (const std::size_t count : Sizes{1, 2, 7, 21, 40}) {
    for (std::size_t n = 0; n < groups.count(); ++n) {
      const SlicePoints points = slice_parameters(info, groups, n);
      ASSERT_EQ(points.size(), groups.groups()[n].size);
      if (count > points.size()) continue;
      for (const auto& labels : {cluster_points(points, count), cluster_points(points, count, 3),
                                 deal_slices(points.size(), count, 3)}) {
        std::vector<std::size_t> sizes(count, 0);
        for (const std::uint32_t label : labels) ++sizes.at(label);
        EXPECT_EQ(std::count(sizes.begin(), sizes.end(), std::size_t{0}), 0) << n << " " << count;
      }
    }
  }
  // views that are neighbours are together
  const SlicePoints line{1, {0, 0.1, 0.2, 5, 5.1, 9}};
  const auto labels = cluster_points(line, 3);
  EXPECT_EQ(labels[0], labels[1]);
  EXPECT_EQ(labels[0], labels[2]);
  EXPECT_EQ(labels[3], labels[4]);
  EXPECT_NE(labels[3], labels[5]);
}

}  // namespace
}  // namespace weft::test
