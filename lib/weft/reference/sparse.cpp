#include "weft/reference/sparse.hpp"

#include <algorithm>
#include <vector>

namespace weft::reference {

void decode_sparse(const SparseModel& model, std::size_t first, std::size_t count,
                   std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t C = shape.channels;
  const SparseLists& V = model.views;
  const SparseLists& P = model.texels;
  std::vector<double> abrdfs(model.abrdf_atoms * C);
  double* texel = out.data();
  for (std::size_t image = first; image < first + count; ++image) {
    const std::size_t view = image / shape.lights;
    const std::size_t light = image % shape.lights;
    // the ABRDFs of this view and light
    std::fill(abrdfs.begin(), abrdfs.end(), 0.0);
    for (std::size_t j = 0; j < model.abrdf_atoms; ++j) {
      for (std::size_t n = 0; n < V.length; ++n) {
        const std::size_t term = (j * shape.views + view) * V.length + n;
        for (std::size_t c = 0; c < C; ++c) {
          abrdfs[j * C + c] +=
              double{V.coefficients[term]} *
              double{model.dictionary[(V.atoms[term] * shape.lights + light) * C + c]};
        }
      }
    }
    for (std::size_t p = 0; p < shape.texels(); ++p, texel += C) {
      for (std::size_t c = 0; c < C; ++c) {
        texel[c] = model.mean[image * C + c];
        for (std::size_t term = p * P.length; term < (p + 1) * P.length; ++term) {
          texel[c] += double{P.coefficients[term]} * abrdfs[P.atoms[term] * C + c];
        }
      }
    }
  }
}

}  // namespace weft::reference
