#include "weft/codecs/long_modes.hpp"

#include <algorithm>
#include <memory>

#include "weft/btf/relabelled_source.hpp"
#include "weft/codecs/btf_panels.hpp"
#include "weft/codecs/panel_stream.hpp"
#include "weft/codecs/streamed_svd.hpp"
#include "weft/error.hpp"
#include "weft/ops/reals.hpp"

namespace weft {
namespace {

// A BTF with its channels as neighbouring texels of one channel: the same bytes.
BtfInfo channels_as_texels(BtfInfo info) {
  info.shape.width *= info.shape.channels;
  info.shape.channels = 1;
  info.channel_names.clear();
  info.mask.clear();
  return info;
}

LongModeVectors vectors_of(Device& device, PanelStream& stream, std::size_t rank, Job& job) {
  SvdTarget target;
  target.rank = std::min({rank, stream.rows(), stream.columns()});
  const StreamedSvd svd = streamed_svd(device, stream, target, job);
  LongModeVectors found;
  found.columns = svd.rank;
  for (std::size_t j = 0; j < svd.rank; ++j) found.squares.push_back(svd.values[j] * svd.values[j]);
  found.vectors.resize(stream.columns() * svd.rank);
  if (svd.rank > 0) {
    ops::read_reals(device, svd.V, stream.arithmetic(), stream.columns(), svd.rank, svd.leading,
                    1.0, std::span<double>(found.vectors));
    return found;
  }
  // of zeros, any direction is as good
  found.columns = 1;
  found.squares = {0.0};
  found.vectors.assign(stream.columns(), 0.0);
  found.vectors[0] = 1.0;
  return found;
}

// How the stream of a group's unfolding comes: rows that the group does not index.
StreamedRows rows_of(const ModeGroup& group) {
  return group.of_directions() ? StreamedRows::texels : StreamedRows::images;
}

bool folds_channels(const ModeGroup& group) {
  return group.of_directions() != group.has(Mode::channel);
}

void require_alone(const ModeGroups& groups, std::size_t n) {
  const ModeGroup& group = groups.groups()[n];
  for (std::size_t m = 0; m < groups.count(); ++m) {
    const ModeGroup& other = groups.groups()[m];
    const bool channels_only = other.modes.size() == 1 && other.has(Mode::channel);
    if (m == n || other.size == 1 || other.of_directions() != group.of_directions()) continue;
    if (channels_only && !group.of_directions()) continue;
    fail_input("mode {} of size {}: beyond {} it must be merged with mode {}", group.name,
               group.size, most_dense_columns, other.name);
  }
}

}  // namespace

LongModeVectors long_mode_vectors(Device& device, TileSource& source, const ModeGroups& groups,
                                  std::size_t n, std::size_t rank, float scale, Job& job) {
  require_alone(groups, n);
  const ModeGroup& group = groups.groups()[n];
  RelabelledSource folded(source, channels_as_texels(source.info()));
  TileSource& from = folds_channels(group) ? folded : source;
  const BtfShape& shape = from.info().shape;
  const std::vector<float> zeros(shape.images() * shape.channels, 0.0f);
  const std::unique_ptr<PanelStream> stream =
      btf_panels(device, from, rows_of(group), Arithmetic::f32, zeros, scale, job);
  LongModeVectors found = vectors_of(device, *stream, rank, job);
  return found;
}

LongModeVectors long_mode_vectors(Device& device, const HeldTensor& T, std::size_t mode,
                                  std::size_t rank, Job& job) {
  const ops::ModeView view = ops::mode_view(T.sizes, mode);
  std::vector<float> turned;
  if (view.inner > 1) {
    turned.resize(T.values.size());
    for (std::size_t o = 0; o < view.outer; ++o) {
      for (std::size_t j = 0; j < view.size; ++j) {
        for (std::size_t i = 0; i < view.inner; ++i) {
          turned[(o * view.inner + i) * view.size + j] =
              T.values[(o * view.size + j) * view.inner + i];
        }
      }
    }
  }
  constexpr std::size_t block_values = std::size_t{2} << 20;
  const std::size_t rows = view.outer * view.inner;
  MatrixPanels stream(
      device, rows, view.size,
      turned.empty() ? std::span(T.values) : std::span<const float>(turned),
      std::clamp<std::size_t>(block_values / std::max<std::size_t>(view.size, 1), 1, rows));
  LongModeVectors found = vectors_of(device, stream, rank, job);
  const double unit = 1 / (stream.scale() * stream.scale());
  for (double& square : found.squares) square *= unit;
  return found;
}

std::size_t long_mode_bytes(Device& device, TileSource& source, const ModeGroups& groups,
                            std::size_t n, std::size_t rank) {
  require_alone(groups, n);
  const ModeGroup& group = groups.groups()[n];
  RelabelledSource folded(source, channels_as_texels(source.info()));
  TileSource& from = folds_channels(group) ? folded : source;
  const BtfShape& shape = from.info().shape;
  const std::size_t images = shape.images() * shape.channels;
  const bool by_images = rows_of(group) == StreamedRows::images;
  SvdTarget target;
  target.rank = std::min({rank, images, shape.texels()});
  const StreamShape stream{by_images ? images : shape.texels(), by_images ? shape.texels() : images,
                           panel_granule(shape, rows_of(group)), Arithmetic::f32};
  return plan_streamed_svd(device, stream, target).total() +
         btf_panels_bytes(device, from, rows_of(group), Arithmetic::f32) +
         group.size * target.rank * (sizeof(double) + sizeof(float));
}

}  // namespace weft
