#include <algorithm>
#include <cmath>

#include "weft/codecs/svd_methods.hpp"
#include "weft/ops/reals.hpp"
#include "weft/ops/syrk.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {

Spectrum gram_spectrum(Device& device, PanelStream& stream, Job& job) {
  const std::size_t m = stream.columns();
  const Arithmetic arithmetic = stream.arithmetic();
  Spectrum spectrum;
  std::vector<double> host(m * m);
  {
    // X^T X, of which only the lower triangle is made
    const double size = static_cast<double>(m);
    const StageTimer timer(job, "Gram matrix", size * size * static_cast<double>(stream.rows()),
                           stream.bytes());
    Buffer G(device, m * m * size_of(arithmetic), "Gram matrix");
    stream.for_each(
        [&](Buffer& panels, std::size_t first, std::size_t count) {
          ops::syrk_packed(device, m, count, 1.0, panels, first == 0 ? 0.0 : 1.0, G, m, arithmetic);
          job.advance("pass 1", first + count, stream.rows());
        },
        &spectrum.squares);
    ops::read_reals(device, G, arithmetic, m, m, m, 1.0, std::span<double>(host));
  }
  if (spectrum.squares > 0) {
    const StageTimer timer(job, "eigenvectors");
    reference::SymmetricEigen eigen = reference::symmetric_eigen(m, host);
    spectrum.values = std::move(eigen.values);
    // Rounding makes eigenvalues of nothing negative.
    for (double& value : spectrum.values) value = std::sqrt(std::max(value, 0.0));
    spectrum.vectors = std::move(eigen.vectors);
  }
  return spectrum;
}

StreamedSvd svd_gram(Device& device, PanelStream& stream, const SvdTarget& target, Job& job) {
  const Spectrum spectrum = gram_spectrum(device, stream, job);
  // Small directions come out mixed with each other: some more hold what the leading ones lack.
  StreamedSvd svd = project(device, stream, target, spectrum, 8, job);
  ++svd.passes;
  return svd;
}

}  // namespace weft
