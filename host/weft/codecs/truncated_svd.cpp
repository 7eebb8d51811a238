#include "weft/codecs/truncated_svd.hpp"

#include <utility>

#include "weft/codecs/streamed_svd.hpp"
#include "weft/error.hpp"

namespace weft {
namespace {

void check(const SvdOptions& options) {
  if (options.method == SvdMethod::gram || options.method == SvdMethod::qr) {
    fail_input("--svd {}: only randomized is available", name_of(options.method));
  }
  if (options.arithmetic == Arithmetic::f64) fail_input("--arithmetic f64: only f32 is available");
  if (options.has_goal()) fail_input("--tolerance and --energy: only --rank is available");
}

}  // namespace

MemoryPlan plan_truncated_svd(Device& device, TileSource& source, const SvdOptions& options) {
  check(options);
  return plan_streamed_svd(device, source, options.rank);
}

TruncatedSvd truncated_svd(Device& device, TileSource& source, const SvdOptions& options,
                           Job& job) {
  check(options);
  StreamedSvd svd = streamed_svd(device, source, options.rank, job);
  return {svd.rank,   std::move(svd.mean),   std::move(svd.left), std::move(svd.right),
          svd.passes, SvdMethod::randomized, "a rank was asked",  svd.error};
}

}  // namespace weft
