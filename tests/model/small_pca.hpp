// A small PCA model in which nothing has its default.
#pragma once

#include "support/generators.hpp"
#include "weft/model/pca.hpp"

namespace weft::test {

inline PcaModel small_pca(Storage storage, std::size_t rank = 2, double magnitude = 1.0,
                          const BtfShape& shape = {2, 3, 4, 5, 3}) {
  PcaModel model;
  model.info.codec = "pca";
  model.info.parameters = R"({"rank":2,"svd":"randomized"})";
  model.info.selection = R"({"level":1})";
  model.info.storage = storage;
  model.info.btf = make_info(shape, DType::f16);
  model.info.btf.encoding = Encoding::gamma22;
  model.info.btf.quantity = Quantity::brdf;
  model.info.btf.source = "a \"capture\"";
  model.info.btf.mask.assign(shape.views * shape.texels(), 1);
  model.info.btf.mask.back() = 0;
  for (std::size_t c = 0; c < shape.channels; ++c) {
    model.info.btf.channel_names.push_back("channel " + std::to_string(c));
  }
  model.info.program_version = "1.2.3";
  ErrorReport& errors = model.info.errors.emplace();
  errors.count = shape.values();
  errors.rmse = 0.01, errors.psnr = 40, errors.snr = 20, errors.relative = 0.1;
  errors.max_error = 0.5;
  model.rank = rank;
  model.mean = random_floats(shape.images() * shape.channels, 1, 0, magnitude);
  model.coefficients = random_floats(shape.texels() * rank, 2, -1, 1);
  model.basis = random_floats(rank * shape.images() * shape.channels, 3, -magnitude, magnitude);
  return model;
}

}  // namespace weft::test
