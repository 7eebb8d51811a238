#include "weft/ops/decode_sparse.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <string>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

// Vectors of texels that a work-item decodes: enough to share the ABRDFs of its images.
constexpr std::size_t texel_vectors = 16;

std::size_t image_blocks(std::size_t width, const DecodeSparseShape& shape) {
  return ceil_div(shape.views * shape.lights, width);
}

}  // namespace

std::size_t sparse_dictionary_floats(std::size_t width, const DecodeSparseShape& shape) {
  return shape.light_atoms * shape.channels * (shape.lights + 2 * width);
}

std::size_t sparse_mean_floats(std::size_t width, const DecodeSparseShape& shape) {
  return shape.channels * image_blocks(width, shape) * width;
}

std::size_t sparse_abrdf_floats(std::size_t width, const DecodeSparseShape& shape) {
  // a run of n images touches one block more than its length says
  const std::size_t blocks =
      std::min(ceil_div(shape.images, width) + 1, image_blocks(width, shape));
  return blocks * shape.abrdf_atoms * shape.channels * width;
}

std::vector<float> sparse_dictionary(std::size_t width, const DecodeSparseShape& shape,
                                     std::span<const float> dictionary) {
  std::vector<float> rows(sparse_dictionary_floats(width, shape), 0.0f);
  const std::size_t row = shape.lights + 2 * width;
  for (std::size_t i = 0; i < shape.light_atoms; ++i) {
    for (std::size_t l = 0; l < shape.lights; ++l) {
      for (std::size_t c = 0; c < shape.channels; ++c) {
        rows[(i * shape.channels + c) * row + width + l] =
            dictionary[(i * shape.lights + l) * shape.channels + c];
      }
    }
  }
  return rows;
}

std::vector<float> sparse_mean(std::size_t width, const DecodeSparseShape& shape,
                               std::span<const float> mean) {
  std::vector<float> rows(sparse_mean_floats(width, shape), 0.0f);
  const std::size_t row = rows.size() / shape.channels;
  for (std::size_t n = 0; n < shape.views * shape.lights; ++n) {
    for (std::size_t c = 0; c < shape.channels; ++c) {
      rows[c * row + n] = mean[n * shape.channels + c];
    }
  }
  return rows;
}

void decode_sparse(Device& device, const DecodeSparseShape& shape, const SparseTerms& V,
                   const SparseTerms& P, const Buffer& dictionary, const Buffer& mean,
                   Buffer& abrdfs, Buffer& out) {
  if (shape.images == 0) return;
  const std::size_t width = vector_width(device);
  const std::string options = fmt::format("{} -DCHANNELS={} -DBLOCK={}", vector_option(device),
                                          shape.channels, texel_vectors);
  const std::size_t first_block = shape.first_image / width;
  const std::size_t blocks = ceil_div(shape.first_image + shape.images, width) - first_block;
  const cl_kernel views = device.kernel(kernel_sources::decode_sparse, options, "combine_views");
  set_arguments(views, ulong(shape.abrdf_atoms), ulong(shape.views), ulong(shape.lights),
                ulong(shape.view_terms), ulong(first_block), V.atoms, V.coefficients, dictionary,
                abrdfs);
  launch_items(device, views, shape.abrdf_atoms, blocks);
  const cl_kernel texels = device.kernel(kernel_sources::decode_sparse, options, "combine_texels");
  set_arguments(texels, ulong(shape.texels), ulong(shape.abrdf_atoms), ulong(shape.texel_terms),
                ulong(image_blocks(width, shape) * width), ulong(shape.first_image),
                ulong(shape.images), ulong(first_block), P.atoms, P.coefficients, abrdfs, mean,
                out);
  launch_items(device, texels, ceil_div(shape.texels, texel_vectors * width), blocks);
}

}  // namespace weft::ops
