#include "weft/job.hpp"

#include <algorithm>

#include "weft/error.hpp"

namespace weft {

std::size_t MemoryPlan::total() const {
  std::size_t sum = 0;
  for (const MemoryItem& item : items) sum += item.bytes;
  return sum;
}

void MemoryPlan::check() const {
  if (total() <= limit) return;
  std::vector<MemoryItem> sorted = items;
  std::sort(sorted.begin(), sorted.end(),
            [](const MemoryItem& a, const MemoryItem& b) { return a.bytes > b.bytes; });
  std::string largest;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, sorted.size()); ++i) {
    largest += fmt::format("{}{} {}", i ? ", " : "", sorted[i].what, sorted[i].bytes);
  }
  fail_input("--memory {}: the job needs at least {} bytes ({})", limit, total(), largest);
}

void Job::plan(MemoryPlan plan) const {
  plan.limit = memory;
  plan.items.insert(plan.items.end(), held.begin(), held.end());
  if (on_plan) on_plan(plan);
  plan.check();
}

Stage& Job::stage(std::string_view name) {
  const auto known =
      std::find_if(stages.begin(), stages.end(), [&](const Stage& s) { return s.name == name; });
  if (known != stages.end()) return *known;
  stages.push_back({std::string(name)});
  return stages.back();
}

StageTimer::StageTimer(Job& job, std::string_view name, double flops, double bytes)
    : job_(job), name_(name), start_(std::chrono::steady_clock::now()) {
  Stage& stage = job_.stage(name_);
  stage.flops += flops;
  stage.bytes += bytes;
}

StageTimer::~StageTimer() {
  job_.stage(name_).seconds +=
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

}  // namespace weft
