#include "weft/codecs/choose_svd.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "weft/btf/texel_block.hpp"
#include "weft/codecs/svd_methods.hpp"
#include "weft/error.hpp"
#include "weft/ops/launch.hpp"

namespace weft {
namespace {

// Short sides for which the host's part is a matter of a second.
constexpr std::size_t small_side = 1024;
// A Gram matrix costs m^2 K flops, and three passes of a block of l columns 12 m K l.
constexpr std::size_t gram_blocks = 12;
// Blocks of texels, each of which reads all of an input that is not mapped.
constexpr std::size_t most_rereads = 4;

// The residual that is wanted, of |A|; |T| is at least as long.
double wanted_error(const SvdOptions& options) {
  double wanted = 1;
  if (options.tolerance > 0) wanted = std::min(wanted, options.tolerance);
  if (options.energy > 0) wanted = std::min(wanted, std::sqrt(1 - options.energy));
  return wanted;
}

SvdChoice choose_by_goal(const SvdOptions& options, std::size_t m, SvdChoice choice) {
  const double wanted = wanted_error(options);
  const char* name = name_of(options.arithmetic).data();
  // Below, an iteration no longer resolves what it still misses.
  const double iterated = options.arithmetic == Arithmetic::f32 ? 1e-5 : 1e-7;
  if (m > small_side && wanted >= iterated) {
    choice.reason = fmt::format("the short side is {}, and a goal needs a part of it", m);
  } else if (wanted >= gram_safe_error(options.arithmetic)) {
    choice.method = SvdMethod::gram;
    choice.reason =
        fmt::format("the short side is {}, and an error of {:.2g} is far above sqrt(eps) of {}", m,
                    wanted, name);
  } else {
    choice.method = SvdMethod::qr;
    choice.reason = fmt::format(
        "the short side is {}, and an error of {:.2g} is too near sqrt(eps) of {} for gram", m,
        wanted, name);
  }
  return choice;
}

SvdChoice choose_by_rank(const Device& device, const SvdOptions& options, std::size_t m,
                         std::size_t K, SvdChoice choice) {
  SvdTarget target;
  target.rank = options.rank;
  const std::size_t block = randomized_block(device, {K, m, 0, options.arithmetic}, target);
  if ((m <= small_side && m <= gram_blocks * block) || m <= 4 * block) {
    choice.method = SvdMethod::gram;
    choice.verify = true;
    choice.reason = fmt::format(
        "the short side is {}: one pass for all of it costs less than "
        "several for {} directions",
        m, block);
  } else {
    choice.reason = fmt::format(
        "the short side is {}: a few passes for {} directions cost less "
        "than one for all of it",
        m, block);
  }
  return choice;
}

}  // namespace

double gram_safe_error(Arithmetic arithmetic) {
  return 32 * std::sqrt(arithmetic == Arithmetic::f32 ? 0x1p-24 : 0x1p-53);
}

SvdChoice choose_svd(const Device& device, TileSource& source, const SvdOptions& options) {
  const BtfShape& shape = source.info().shape;
  const std::size_t texels = shape.texels();
  const std::size_t n = shape.images() * shape.channels;
  const std::size_t m = std::min(texels, n);
  const std::size_t K = std::max(texels, n);
  SvdChoice choice;
  if (options.method == SvdMethod::randomized) {
    choice.reason = "as asked";
    return choice;
  }
  const StreamedRows short_rows = texels <= n ? StreamedRows::images : StreamedRows::texels;
  if (options.method != SvdMethod::automatic) {
    if (m > most_dense_columns) {
      fail_input(
          "--svd {}: the short side of {} texels x {} image channels is {}, at most {} are taken",
          name_of(options.method), texels, n, m, most_dense_columns);
    }
    return {options.method, short_rows, "as asked", false};
  }
  if (m > most_dense_columns) {
    choice.reason =
        fmt::format("the short side is {}, gram and qr take at most {}", m, most_dense_columns);
    return choice;
  }
  const std::size_t blocks = ops::ceil_div(texels, texel_granule(shape));
  if (short_rows == StreamedRows::texels && blocks > most_rereads && source.mapped(0, 1).empty()) {
    choice.reason = fmt::format(
        "gram and qr would read this input {} times, since its images are not mapped", blocks);
    return choice;
  }
  choice = options.tolerance > 0 || options.energy > 0
               ? choose_by_goal(options, m, std::move(choice))
               : choose_by_rank(device, options, m, K, std::move(choice));
  if (choice.method != SvdMethod::randomized) choice.rows = short_rows;
  return choice;
}

}  // namespace weft
