// The fit of `vq` to one or more sources, materials and their mip levels, that share code-books
// (Havran et al. 2010, section 5.1). Each adds what it needs, one after the other, by thresholds
// that are parts of its own luminance; when the code-books are complete, the texels of all take
// their entries. Code-books that are there already keep their code-vectors.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

#include "weft/btf/tile.hpp"
#include "weft/job.hpp"
#include "weft/reference/vq.hpp"

namespace weft {

using VqSources = std::vector<TileSource*>;
using MakeVqEngine = std::function<std::unique_ptr<VqEngine>(const BtfInfo& source)>;

struct VqFit {
  std::unique_ptr<VqModel> model;   // unrounded code-books; its info holds nothing yet
  std::vector<VqCodeBook> indices;  // P6 of each source
  std::size_t trained = 0;          // texels
};

// Texels that code-books are made of.
std::size_t vq_trained(const VqSources& sources, const VqRequest& request);

// What a job takes that has one of the plans at a time: each item's largest.
MemoryPlan largest_of(const std::vector<MemoryPlan>& plans);

class VqJointFit {
 public:
  // Reads all sources once, and makes an engine for each set of directions. The sources must
  // outlive it; so must `base`, code-books to be continued, if there are any.
  VqJointFit(VqSources sources, MakeVqEngine make_engine, const VqRequest& request, Job& job,
             const VqModel* base = nullptr);

  // With these thresholds in place of the request's.
  VqFit fit(const VqThresholds& thresholds);

 private:
  // The fitter of a source, with an engine that others of its directions share. One is there at a
  // time.
  VqFitter& fitter(std::size_t source);

  VqSources sources_;
  MakeVqEngine make_engine_;
  VqRequest request_;
  Job& job_;
  const VqModel* base_;
  std::unique_ptr<VqEngine> engine_;
  const BtfInfo* engine_info_ = nullptr;
  std::unique_ptr<VqFitter> fitter_;
  std::size_t current_ = 0;
  bool has_read_ = false;  // the fitter that is there
  int unit_ = 0;           // exponent of what all values are multiplied with
};

}  // namespace weft
