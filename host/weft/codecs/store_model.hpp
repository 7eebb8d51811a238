// The last step of an encoder: a model fitted in float becomes what its file will hold.
//
// `auto` looks for the steps of least size that leave the error within a bound. With fine steps a
// value of tensor t and component j takes log2(1 / step) bits up to a constant, and adds
// g_tj step^2 / 12 to the squared error, where the gain g_tj is by how much the squared error grows
// with that of the component's values. The least size for a sum of errors then has the same
// g_tj step_tj^2 = lambda^2 everywhere (Lagrange), and so has the least error for a size. Gains are
// measured: a component, or a group of them, is quantised alone, and images of all views and lights
// are decoded and compared. lambda is found by measuring the whole model, or the size of its file.
#pragma once

#include <optional>

#include "weft/btf/weights.hpp"
#include "weft/codecs/codec.hpp"
#include "weft/model/file_sizer.hpp"
#include "weft/model/storage.hpp"

namespace weft {

// What `auto` keeps the error or the file within.
struct StorageBound {
  // The squared error against the source that the model may have, weighted where there are weights;
  // without one, (1 + slack)^2 times that of half storage, which is taken where it is smaller.
  std::optional<double> most_squares = std::nullopt;
  // Instead: the most bytes of the file when its errors are known. Steps are as fine as they allow.
  std::size_t most_bytes = 0;
  const Weights* weights = nullptr;  // of the source, each mode's of mean 1; null: all equal
  // Of several models in so many bytes: where to begin, kept for the next one.
  FileSizer* sizer = nullptr;
  double* bytes_of_bit =
      nullptr;  // of the entropy of steps that differ from component to component
};

// Rounds or quantises a model that was fitted with request.fitted(). On the device, or by the
// reference if it is null. False where the coarsest steps take more than the most bytes.
bool store_model(Device* device, Model& model, TileSource& source, const StorageRequest& request,
                 Job& job, const StorageBound& bound = {});

// Bytes that storing a model of so many numbers takes beside the model, about.
std::size_t storing_bytes(const StorageRequest& request, std::size_t numbers);

}  // namespace weft
