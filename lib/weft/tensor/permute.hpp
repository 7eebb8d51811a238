// Row-major tensors with their modes in another order.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace weft {

// out[i_{axes[0]}, i_{axes[1]}, ..] = values[i_0, i_1, ..]: mode k of the result is mode axes[k] of
// `values`, whose sizes are given.
template <typename T>
std::vector<T> permuted(std::span<const T> values, std::span<const std::size_t> sizes,
                        std::span<const std::size_t> axes) {
  const std::size_t modes = sizes.size();
  std::vector<std::size_t> from(modes, 1);
  for (std::size_t n = modes; n-- > 1;) from[n - 1] = from[n] * sizes[n];
  std::vector<T> out(values.size());
  if (modes == 0 || out.empty()) {
    out.assign(values.begin(), values.end());
    return out;
  }
  // The last mode of the result is the inner loop, the others count.
  const std::size_t inner = sizes[axes[modes - 1]];
  const std::size_t step = from[axes[modes - 1]];
  std::vector<std::size_t> index(modes, 0);
  std::size_t at = 0;
  for (std::size_t done = 0; done < out.size(); done += inner) {
    for (std::size_t i = 0; i < inner; ++i) out[done + i] = values[at + i * step];
    for (std::size_t n = modes - 1; n-- > 0;) {
      at += from[axes[n]];
      if (++index[n] < sizes[axes[n]]) break;
      at -= from[axes[n]] * sizes[axes[n]];
      index[n] = 0;
    }
  }
  return out;
}

}  // namespace weft
