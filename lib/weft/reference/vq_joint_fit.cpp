#include "weft/reference/vq_joint_fit.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace weft {
namespace {

// The exponent that brings the largest magnitude into (0.5, 1]: 8-bit data with white in it stays
// as it is, and similarities have their usual constants.
int unit_exponent(double largest) {
  int exponent = 0;
  const double mantissa = std::frexp(largest, &exponent);
  if (mantissa == 0.5) --exponent;
  return largest > 0 ? -exponent : 0;
}

bool same_directions(const BtfInfo& a, const BtfInfo& b) {
  return a.view_directions == b.view_directions && a.light_directions == b.light_directions &&
         a.layout == b.layout;
}

}  // namespace

std::size_t vq_trained(const VqSources& sources, const VqRequest& request) {
  std::size_t trained = 0;
  for (const TileSource* source : sources) {
    trained += vq_training(source->info().shape, request).texels.size();
  }
  return trained;
}

MemoryPlan largest_of(const std::vector<MemoryPlan>& plans) {
  MemoryPlan largest = plans.front();
  for (const MemoryPlan& plan : plans) {
    for (std::size_t i = 0; i < plan.items.size(); ++i) {
      largest.items[i].bytes = std::max(largest.items[i].bytes, plan.items[i].bytes);
    }
  }
  return largest;
}

VqJointFit::VqJointFit(VqSources sources, MakeVqEngine make_engine, const VqRequest& request,
                       Job& job, const VqModel* base)
    : sources_(std::move(sources)),
      make_engine_(std::move(make_engine)),
      request_(request),
      job_(job),
      base_(base) {
  double largest = 0;
  // the first one last, since the code-books begin with it
  for (std::size_t source = sources_.size(); source-- > 0;) {
    largest = std::max(largest, fitter(source).read());
  }
  has_read_ = true;
  if (base_ != nullptr) {
    for (const float value : base_->c) largest = std::max(largest, std::abs(double{value}));
  }
  unit_ = unit_exponent(largest);
  fitter_->set_unit(unit_);
}

VqFitter& VqJointFit::fitter(std::size_t source) {
  if (fitter_ && current_ == source) return *fitter_;
  fitter_.reset();
  const BtfInfo& info = sources_[source]->info();
  if (!engine_info_ || !same_directions(*engine_info_, info)) {
    engine_.reset();
    engine_ = make_engine_(info);
    engine_info_ = &info;
  }
  fitter_ = std::make_unique<VqFitter>(*sources_[source], *engine_, request_, job_);
  current_ = source;
  has_read_ = false;
  return *fitter_;
}

VqFit VqJointFit::fit(const VqThresholds& thresholds) {
  VqFit fit;
  fit.trained = vq_trained(sources_, request_);
  fit.model = std::make_unique<VqModel>();
  VqModel& model = *fit.model;
  const std::size_t channels = sources_.front()->info().shape.channels;
  VqCodeBooks books(request_.grid, channels, job_.memory / 4);
  if (base_ != nullptr) books.continue_from(*base_, unit_);
  for (std::size_t source = 0; source < sources_.size(); ++source) {
    VqFitter& one = fitter(source);
    if (!has_read_) {
      one.read();
      one.set_unit(unit_);
      has_read_ = true;
    }
    one.train(books, thresholds);
  }
  books.fill(model);
  scale_all(model.c, -unit_);
  // those that were there, bit for bit
  if (base_ != nullptr) std::copy(base_->c.begin(), base_->c.end(), model.c.begin());
  fit.indices.resize(sources_.size());
  // from the source at hand back to the first, with which the next fit begins
  for (std::size_t source = sources_.size(); source-- > 0;) {
    VqFitter& one = fitter(source);
    if (!has_read_) one.set_unit(unit_);
    fit.indices[source] = one.assign(books);
    scale_all(fit.indices[source].scales, -unit_);
  }
  for (std::size_t channel = 0; channel < channels; ++channel) {
    model.channels.push_back(static_cast<std::uint8_t>(channel));
  }
  model.seal();
  return fit;
}

}  // namespace weft
