#include "weft/codecs/refit_kcta.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace weft {
namespace {

constexpr std::size_t most_refits = 4;

// The first model for which `found` holds, as it does for all larger ones; the last if for none.
template <typename Found>
std::size_t first_model(const NestedModels& models, const Found& found) {
  std::size_t low = 0;
  std::size_t high = models.count() - 1;
  while (low < high) {
    const std::size_t middle = low + (high - low) / 2;
    if (found(middle)) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

double relative_error(const KctaErrors& errors) {
  if (errors.squares == 0) return 0;
  return std::sqrt((errors.lost + errors.history.back()) / errors.squares);
}

KctaFit refit(KctaEncoder& encoder, const NestedModels& models, std::size_t i,
              std::size_t iterations) {
  const std::unique_ptr<Model> start = models.model(i);
  return encoder.refit(dynamic_cast<const KctaModel&>(*start),
                       std::max<std::size_t>(iterations, 1));
}

}  // namespace

std::unique_ptr<NestedModels> refitted(std::unique_ptr<NestedModels> whole, KctaEncoder& encoder,
                                       const NestedRequest& request, std::size_t iterations,
                                       const NestKcta& nest) {
  const std::size_t last = whole->count() - 1;
  if (request.relative == 0) {
    // room for the search to cut back
    constexpr double spare = 1.06;
    const double wanted = spare * request.growth * static_cast<double>(request.values);
    const std::size_t at = first_model(
        *whole, [&](std::size_t i) { return static_cast<double>(whole->values(i)) >= wanted; });
    if (at == last) return whole;
    return nest(refit(encoder, *whole, at, iterations), 2);
  }
  constexpr double hoped = 1.08;  // of the error before it is fitted again
  constexpr double near = 0.98;   // of the wanted error, 0.18 dB
  constexpr double aimed = 0.99;
  double error = hoped * request.relative;
  std::size_t before = last;
  KctaFit best;
  std::size_t fits = 1;
  while (fits <= most_refits) {
    const std::size_t at =
        first_model(*whole, [&](std::size_t i) { return whole->error(i) <= error; });
    if (at == last || at == before) break;
    before = at;
    KctaFit fit = refit(encoder, *whole, at, iterations);
    ++fits;
    const double found = relative_error(fit.errors);
    const bool meets = found <= request.relative;
    if (!meets && best.model) break;
    if (meets) best = std::move(fit);
    if (meets && found >= near * request.relative) break;
    error *= aimed * request.relative / std::max(found, 1e-9);
  }
  return best.model ? nest(std::move(best), fits) : std::move(whole);
}

}  // namespace weft
