#include "weft/codecs/vq_base.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <utility>

#include "weft/codecs/vq.hpp"
#include "weft/codecs/vq_engine.hpp"
#include "weft/codecs/vq_goal.hpp"
#include "weft/codecs/vq_levels.hpp"
#include "weft/error.hpp"
#include "weft/model/file_sizer.hpp"
#include "weft/model/material_file.hpp"
#include "weft/model/storage.hpp"
#include "weft/version.hpp"

namespace weft {
namespace {

using Clock = std::chrono::steady_clock;

// One material on its way: what is fitted of it, level by level.
struct Prepared {
  const MaterialSource* material = nullptr;
  ColourTransform transform;
  std::unique_ptr<TransformedSource> transformed;
  VqRequest request;
  std::unique_ptr<VqLevels> levels;
  std::size_t first = 0;  // of its sources among those of all
};

// How new tensors are stored: like those of the data base.
StorageRequest storage_like(const VqBase& base) {
  const ModelInfo& info = base.books.info;
  StorageRequest storage;
  if (!info.quantised.empty()) {
    storage.kind = StorageRequest::Kind::bits;
    storage.bits = info.quantised.begin()->second.bits;
  } else if (info.storage == Storage::f32) {
    storage.kind = StorageRequest::Kind::single;
  }
  return storage;
}

void check_storage(const StorageRequest& storage, const VqBase* existing) {
  using Kind = StorageRequest::Kind;
  if (storage.kind == Kind::automatic) {
    fail_input(
        "--storage auto: finds the steps of one model; materials that share code-books take "
        "f16, f32 or q=BITS");
  }
  if (existing == nullptr) return;
  const Kind there = storage_like(*existing).kind;
  if (storage.kind != there) {
    fail_input("--storage: the data base is stored as {}, and what is added to it is, too",
               there == Kind::half     ? "f16"
               : there == Kind::single ? "f32"
                                       : "q=BITS");
  }
}

void store(VqModel& model, const StorageRequest& storage) {
  if (storage.kind == StorageRequest::Kind::bits) {
    quantise_others(model, storage.bits);
  } else {
    round_to_storage(model);
  }
}

class BaseFit {
 public:
  BaseFit(Device* device, std::span<const MaterialSource> materials, const CompressRequest& request,
          const VqBase* existing, Job& job)
      : device_(device), materials_(materials), request_(request), existing_(existing), job_(job) {
    check_names();
    check_storage(request.storage, existing);
    for (const MaterialSource& material : materials) prepare(material);
    check_agreement();
    plan();
    joint_.emplace(
        sources_, [this](const BtfInfo& info) { return make_engine(info); }, vq(), job_,
        existing_ != nullptr ? &existing_->books : nullptr);
  }

  VqBaseResult run() {
    const Clock::time_point start = Clock::now();
    VqBaseResult result;
    if (request_.goal) {
      meet(result);
    } else {
      result.base = fit(vq().thresholds);
      result.measured = measure(result.base);
    }
    // the errors belong to the materials as they are stored
    const std::size_t before = result.base.materials.size() - materials_.size();
    for (std::size_t i = 0; i < materials_.size(); ++i) {
      result.base.materials[before + i].index.info.errors = result.measured[i].errors;
    }
    result.encode_seconds = std::chrono::duration<double>(Clock::now() - start).count();
    return result;
  }

 private:
  const VqRequest& vq() const { return prepared_.front().request; }

  void check_names() const {
    for (std::size_t i = 0; i < materials_.size(); ++i) {
      const std::string& name = materials_[i].name;
      check_material_name(name, "--names");
      const bool there = existing_ != nullptr && existing_->has(name);
      const bool twice =
          std::any_of(materials_.begin(), materials_.begin() + static_cast<std::ptrdiff_t>(i),
                      [&](const MaterialSource& other) { return other.name == name; });
      if (there || twice) {
        fail_input("material '{}': {}; --names gives another", name,
                   there ? "the data base has one of that name" : "two are named so");
      }
    }
  }

  void prepare(const MaterialSource& material) {
    Prepared one;
    one.material = &material;
    TileSource& source = *material.source;
    one.transform = choose_colour_transform(source, material.colour, job_);
    TileSource* fitted = &source;
    if (!one.transform.is_identity()) {
      one.transformed = std::make_unique<TransformedSource>(source, one.transform, job_.nan_zero);
      fitted = one.transformed.get();
    }
    one.request = vq_request(request_.parameters, fitted->info());
    one.levels = std::make_unique<VqLevels>(*fitted, one.request.levels, job_.nan_zero);
    one.first = sources_.size();
    for (TileSource* level : one.levels->sources()) sources_.push_back(level);
    prepared_.push_back(std::move(one));
  }

  ModelInfo describe(const Prepared& one) const {
    ModelInfo info;
    info.codec = vq_codec().name();
    info.storage = request_.storage.fitted();
    info.btf = one.material->source->info();
    info.btf.mask_distance.clear();
    info.selection = one.material->selection;
    info.colour_transform = one.transform;
    info.program_version = version();
    return info;
  }

  void check_agreement() const {
    VqBase first;
    const VqBase* common = existing_;
    if (common == nullptr) {
      const Prepared& one = prepared_.front();
      first.books.grid = vq().grid;
      first.books.chromaticities = one.material->source->info().shape.channels - 1;
      first.materials.push_back({one.material->name, {}});
      first.materials.back().index.info = describe(one);
      common = &first;
    }
    for (const Prepared& one : prepared_) {
      check_shares(*common, describe(one), one.request.grid,
                   one.material->source->info().shape.channels,
                   fmt::format("material '{}'", one.material->name));
    }
  }

  void plan() const {
    const std::size_t trained = vq_trained(sources_, vq());
    std::vector<MemoryPlan> plans;
    for (const TileSource* source : sources_) {
      plans.push_back(device_ ? plan_device_vq(*device_, source->info(), vq(), trained, job_)
                              : plan_vq(source->info(), vq(), trained, job_));
    }
    job_.plan(largest_of(plans));
  }

  std::unique_ptr<VqEngine> make_engine(const BtfInfo& info) const {
    return device_ ? device_vq_engine(*device_, info, vq()) : reference::vq_engine(info, vq());
  }

  // All as it is stored.
  VqBase fit(const VqThresholds& thresholds) {
    VqFit result = joint_->fit(thresholds);
    VqBase base;
    base.books = std::move(*result.model);
    VqModel& books = base.books;
    books.info.codec = vq_codec().name();
    books.info.storage = request_.storage.fitted();
    if (existing_ != nullptr) {
      base.materials = existing_->materials;
      for (VqMaterial& material : base.materials) repack(material.index, books.sizes.p4);
      books.info.quantised = existing_->books.info.quantised;
      books.earlier = existing_->books.earlier;
      books.earlier.push_back(existing_->books.sizes);
      books.seal();
    }
    store(books, request_.storage);
    for (const Prepared& one : prepared_) {
      VqMaterial material{one.material->name, {}};
      material.index.info = describe(one);
      one.levels->take(result.indices, one.first, material.index);
      material.index.info.parameters = vq_parameters_json(books, one.request, thresholds);
      material.index.info.errors = longest_errors(false);
      store(material.index, request_.storage);
      base.materials.push_back(std::move(material));
    }
    note(books, result.trained);
    return base;
  }

  // Indices take more bits of more entries.
  static void repack(VqModel& index, std::size_t entries) {
    const auto pack = [&](VqCodeBook& p6) {
      const auto old = p6.entries.indices();
      p6.entries = PackedIndices({old.begin(), old.end()}, entries);
    };
    pack(index.p6);
    for (VqCodeBook& level : index.coarser) pack(level);
  }

  void note(const VqModel& books, std::size_t trained) {
    const VqModel::Sizes& s = books.sizes;
    job_.notes.push_back(fmt::format(
        "code-books of {} texels of {} materials{}: P4 {}, P3 {}, M {}, P2 {}, P1 {}, I2 {}, I1 "
        "{}, C {}",
        trained, materials_.size(), existing_ != nullptr ? " beside those that were there" : "",
        s.p4, s.p3, s.m, s.p2, s.p1, s.i2, s.i1, s.c));
  }

  std::vector<MeasuredModel> measure(const VqBase& base) {
    std::vector<MeasuredModel> measured;
    const std::size_t before = base.materials.size() - materials_.size();
    for (std::size_t i = 0; i < materials_.size(); ++i) {
      const std::unique_ptr<VqModel> model = base.model(before + i);
      measured.push_back(measure_model(device_, *materials_[i].source, request_, *model, job_));
    }
    return measured;
  }

  // Most bytes of the file. What a ratio is of are all materials.
  std::size_t most_bytes() const {
    if (request_.goal.kind == GoalKind::size) return request_.goal.bytes;
    double raw = 0;
    for (const MaterialSource& material : materials_) {
      raw += static_cast<double>(material.source->info().bytes());
    }
    if (existing_ != nullptr) {
      for (const VqMaterial& material : existing_->materials) {
        raw += static_cast<double>(material.index.info.btf.bytes());
      }
    }
    return static_cast<std::size_t>(raw / request_.goal.value);
  }

  void meet(VqBaseResult& result) {
    const Goal& goal = request_.goal;
    const bool by_size = goal.by_size();
    const std::size_t allowed = by_size ? most_bytes() : 0;
    const VqThresholds& given = vq().thresholds;
    const bool bounded = request_.parameters.contains("threshold") && given.p4 > 0;
    // one that says all levels' thresholds, P4's being 1
    const VqThresholds unit = given.p4 > 0 ? given.times(1 / given.p4) : given;
    result.goal.emplace();
    bool found = false;
    double reached = 0;  // of the material that is the farthest from the goal, or of the file
    const auto met = [&](double factor) {
      check_interrupt();
      VqBase base = fit(unit.times(factor));
      const std::size_t bytes = vq_base_size(base);
      ++result.goal->decompositions;
      std::vector<MeasuredModel> measured;
      bool meets = bytes <= allowed;
      reached = reached_size(bytes);
      if (!by_size) {
        measured = measure(base);
        ++result.goal->trials;
        const ErrorReport& worst = worst_of(measured).errors;
        meets = goal.met(worst);
        reached = goal.reached(worst);
      }
      job_.notes.push_back(
          fmt::format("thresholds of {:.4g}: {} bytes, {:.4g} reached", factor, bytes, reached));
      if (meets) {
        found = true;
        result.goal->reached = reached;
        result.base = std::move(base);
        result.measured = std::move(measured);
      }
      return meets;
    };
    search_factor({by_size, by_size ? 0.1 : 0.2, bounded ? given.p4 : 0}, met);
    if (!found) {
      fail(ErrorKind::unmet_goal, "--target {}: {:.6g} was reached by {}", goal.text, reached,
           by_size ? "the file" : "the worst of the materials");
    }
    if (by_size) {
      result.measured = measure(result.base);
      ++result.goal->trials;
    }
  }

  // The one that is the farthest from the goal, or the nearest to missing it.
  const MeasuredModel& worst_of(const std::vector<MeasuredModel>& measured) const {
    return *std::min_element(
        measured.begin(), measured.end(), [&](const MeasuredModel& a, const MeasuredModel& b) {
          return request_.goal.missing_factor(a.errors) < request_.goal.missing_factor(b.errors);
        });
  }

  double reached_size(std::size_t bytes) const {
    if (request_.goal.kind == GoalKind::size) return static_cast<double>(bytes);
    return request_.goal.value * static_cast<double>(most_bytes()) / static_cast<double>(bytes);
  }

  Device* device_;
  std::span<const MaterialSource> materials_;
  const CompressRequest& request_;
  const VqBase* existing_;
  Job& job_;
  std::vector<Prepared> prepared_;
  VqSources sources_;
  std::optional<VqJointFit> joint_;
};

}  // namespace

Parameters with_grid_of(const VqBase& base, Parameters parameters) {
  const VqGrid& grid = base.books.grid;
  const bool onion = grid.kind == VqGrid::Kind::onion;
  parameters.emplace("grid", onion ? "onion" : "measured");
  if (onion && parameters["grid"] == "onion") {
    const OnionSizes& n = grid.sizes;
    parameters.emplace("slices", fmt::format("{},{},{},{}", n.alpha, n.beta, n.theta, n.phi));
  }
  return parameters;
}

VqBaseResult compress_vq_base(Device* device, std::span<const MaterialSource> materials,
                              const CompressRequest& request, const VqBase* existing, Job& job) {
  check_parameters(vq_codec(), request.parameters);
  CompressRequest own = request;
  own.codec = &vq_codec();
  if (existing != nullptr) {
    own.parameters = with_grid_of(*existing, own.parameters);
    if (own.may_widen) own.storage = storage_like(*existing);
  }
  return BaseFit(device, materials, own, existing, job).run();
}

}  // namespace weft
