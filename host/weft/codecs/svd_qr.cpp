#include "weft/codecs/svd_methods.hpp"
#include "weft/ops/tsqr.hpp"
#include "weft/reference/factorise.hpp"

namespace weft {

Spectrum qr_spectrum(Device& device, PanelStream& stream, ops::Tsqr::Workspace workspace,
                     Job& job) {
  const std::size_t m = stream.columns();
  Spectrum spectrum;
  std::vector<double> R;
  {
    const double size = static_cast<double>(m);
    const StageTimer timer(job, "QR", 2 * size * size * static_cast<double>(stream.rows()),
                           stream.bytes());
    ops::Tsqr tsqr(device, m, stream.arithmetic(), workspace);
    stream.for_each(
        [&](Buffer& panels, std::size_t first, std::size_t count) {
          tsqr.add(panels, count);
          job.advance("pass 1", first + count, stream.rows());
        },
        &spectrum.squares);
    R = tsqr.R();
  }
  if (spectrum.squares > 0) {
    const StageTimer timer(job, "singular vectors");
    reference::ThinSvd svd = reference::thin_svd(m, m, R);
    spectrum.values = std::move(svd.values);
    spectrum.vectors = std::move(svd.V);
  }
  return spectrum;
}

StreamedSvd svd_qr(Device& device, PanelStream& stream, const SvdTarget& target, Job& job) {
  const Spectrum spectrum = qr_spectrum(device, stream, target.workspace, job);
  StreamedSvd svd = project(device, stream, target, spectrum, 8, job);
  ++svd.passes;
  return svd;
}

}  // namespace weft
