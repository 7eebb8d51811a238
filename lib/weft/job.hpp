// What a long job is given and what it tells: limits, progress, the memory it foresees, and where
// its time went.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace weft {

// One item of the memory that a job will need, in bytes.
struct MemoryItem {
  std::string what;
  std::size_t bytes = 0;
};

// Device and host memory that a job takes at its peak, foreseen before it starts. Mapped pages of
// the input are not counted: they are given back as they are consumed.
struct MemoryPlan {
  std::vector<MemoryItem> items;
  std::size_t limit = 0;  // --memory

  std::size_t total() const;
  void add(std::string what, std::size_t bytes) { items.push_back({std::move(what), bytes}); }
  // Throws an input error that names the total, the limit and the largest items if they do not fit.
  void check() const;
};

// Time, floating-point operations and bytes of one stage of a job. The bytes are those that have to
// pass through memory: the input read, and results written.
struct Stage {
  std::string name;
  double seconds = 0;
  double flops = 0;
  double bytes = 0;
};

class Job {
 public:
  // The most memory that the job may take, in bytes.
  std::size_t memory = std::size_t{2} << 30;
  // What the caller holds meanwhile: counted in every plan.
  std::vector<MemoryItem> held;
  // Seeds every generator.
  std::uint64_t seed = 0;
  // Read NaN and infinities as 0 instead of refusing them.
  bool nan_zero = false;
  // Called as a stage advances; `total` images (or other units) in all.
  std::function<void(const std::string& stage, std::size_t done, std::size_t total)> progress;
  // Called once with the plan, before the work.
  std::function<void(const MemoryPlan& plan)> on_plan;

  // In the order in which they first began.
  std::vector<Stage> stages;
  // What was chosen on the way, and why: lines for the report.
  std::vector<std::string> notes;

  void advance(const std::string& stage, std::size_t done, std::size_t total) const {
    if (progress) progress(stage, done, total);
  }
  // Checks the plan and passes it on.
  void plan(MemoryPlan plan) const;
  // The stage of that name.
  Stage& stage(std::string_view name);
};

// Adds the time of its scope to a stage.
class StageTimer {
 public:
  StageTimer(Job& job, std::string_view name, double flops = 0, double bytes = 0);
  ~StageTimer();
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  Job& job_;
  std::string name_;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace weft
