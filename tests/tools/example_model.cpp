#include "tools/example_model.hpp"

#include "support/generators.hpp"
#include "weft/model/model_file.hpp"
#include "weft/model/pca.hpp"
#include "weft/model/tt.hpp"

namespace weft::test {

namespace {

PcaModel pca_model(const BtfShape& shape) {
  PcaModel model;
  model.info.codec = "pca";
  model.info.parameters = R"({"rank":2})";
  model.info.storage = Storage::f32;
  model.info.btf = make_info(shape, DType::f16);
  model.info.program_version = "0.0.1";
  ErrorReport errors;
  errors.rmse = 0.125;
  errors.psnr = 18.0625;
  model.info.errors = errors;
  model.rank = 2;
  model.mean = random_floats(shape.images() * shape.channels, 2);
  model.coefficients = random_floats(shape.texels() * 2, 3);
  model.basis = random_floats(2 * shape.images() * shape.channels, 4);
  return model;
}

}  // namespace

std::filesystem::path write_pca_model(const std::filesystem::path& path, const BtfShape& shape) {
  write_model(path, pca_model(shape));
  return path;
}

std::filesystem::path write_overflowing_model(const std::filesystem::path& path) {
  TtModel model;
  model.info = pca_model({1, 1, 1, 2, 1}).info;
  model.info.codec = "tt";
  model.info.parameters = R"({"order":"x,y,c,v,l","ranks":"1,1,1,1"})";
  model.order = parse_order("x,y,c,v,l", "--order");
  model.ranks.fill(1);
  model.cores = {{{1e30f, 0}, {1e30f}, {1}, {0}, {0}}};
  write_model(path, model);
  return path;
}

}  // namespace weft::test
