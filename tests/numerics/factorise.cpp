#include <cmath>
#include <vector>

#include "numerics/errors.hpp"
#include "weft/codecs/panel_stream.hpp"
#include "weft/codecs/streamed_svd.hpp"

namespace weft::numerics {
namespace {

// Rows of a streamed block: several of them in most cases.
constexpr std::size_t granule = 300;
constexpr std::size_t granule_of_long = 1 << 16;

// The first `columns` of [rows][leading].
template <typename Real>
std::vector<double> read(Device& device, const Buffer& buffer, std::size_t rows,
                         std::size_t columns, std::size_t leading) {
  std::vector<Real> stored(rows * leading);
  device.read(buffer, std::span<Real>(stored));
  std::vector<double> values(rows * columns);
  for (std::size_t i = 0; i < rows; ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      values[i * columns + j] = static_cast<double>(stored[i * leading + j]);
    }
  }
  return values;
}

template <typename Real>
Computed factorise_in(Device& device, const Matrix& matrix, std::size_t rank, SvdMethod method) {
  const std::vector<Real> values(matrix.values.begin(), matrix.values.end());
  MatrixPanels stream(device, matrix.rows, matrix.columns, std::span<const Real>(values),
                      matrix.rows > 100 * granule ? granule_of_long : granule);
  SvdTarget target;
  target.method = method;
  target.rank = rank;
  Job job;
  const StreamedSvd svd = streamed_svd(device, stream, target, job);
  Computed computed;
  computed.rank = svd.rank;
  computed.exponent = std::ilogb(stream.scale());
  computed.values = svd.values;
  if (svd.rank == 0) return computed;
  computed.V = read<Real>(device, svd.V, matrix.columns, svd.rank, svd.leading);
  computed.XV = read<Real>(device, svd.XV, matrix.rows, svd.rank, svd.leading);
  return computed;
}

}  // namespace

Computed factorise(Device& device, const Matrix& matrix, std::size_t rank, SvdMethod method,
                   Arithmetic arithmetic) {
  return arithmetic == Arithmetic::f32 ? factorise_in<float>(device, matrix, rank, method)
                                       : factorise_in<double>(device, matrix, rank, method);
}

}  // namespace weft::numerics
