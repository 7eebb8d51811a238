#include "weft/reference/view_pca.hpp"

#include <algorithm>
#include <vector>

#include "weft/btf/view_source.hpp"
#include "weft/reference/pca.hpp"
#include "weft/reference/tile.hpp"

namespace weft::reference {

ViewPcaFit encode_view_pca(TileSource& source, const SvdRequest& request, Job& job) {
  const BtfShape& shape = source.info().shape;
  const std::size_t light_channels = shape.lights * shape.channels;
  const std::size_t smaller = std::min(shape.texels(), light_channels);
  const std::size_t most = request.rank > 0 ? std::min(request.rank, smaller) : smaller;
  MemoryPlan plan;
  plan.add("image", shape.image_values() * sizeof(double));
  plan.add("model", shape.views * (most * (shape.texels() + light_channels) + light_channels) *
                        sizeof(float));
  job.plan(plan);

  // NaN is looked for in the whole, where it has its own view's number.
  std::vector<double> image(shape.image_values());
  for (std::size_t i = 0; i < shape.images(); ++i) read_tile(source, i, 1, job.nan_zero, image);

  ViewPcaFit fit;
  fit.model = std::make_unique<ViewPcaModel>();
  ViewPcaModel* const model = fit.model.get();
  std::vector<std::uint32_t> ranks;
  Job view_job = job;  // one plan and one progress: those of the whole
  view_job.progress = {};
  view_job.on_plan = {};
  view_job.held.insert(view_job.held.end(), plan.items.begin(), plan.items.end());
  for (std::size_t v = 0; v < shape.views; ++v) {
    ViewSource view(source, v);
    const PcaFit view_fit = encode_pca(view, request, view_job);
    const PcaModel* const pca = view_fit.model.get();
    if (v == 0) fit.method = view_fit.method;
    fit.passes = std::max(fit.passes, view_fit.passes);
    fit.residual_squares += view_fit.residual * view_fit.residual;
    ranks.push_back(static_cast<std::uint32_t>(pca->rank));
    model->mean.insert(model->mean.end(), pca->mean.begin(), pca->mean.end());
    model->basis.insert(model->basis.end(), pca->basis.begin(), pca->basis.end());
    for (std::size_t j = 0; j < pca->rank; ++j) {
      for (std::size_t p = 0; p < shape.texels(); ++p) {
        model->images.push_back(pca->coefficients[p * pca->rank + j]);
      }
    }
    job.advance("views", v + 1, shape.views);
  }
  job.stages = std::move(view_job.stages);
  model->ranks = IndexTensor(ranks, *std::max_element(ranks.begin(), ranks.end()) + std::size_t{1});
  return fit;
}

void decode_view_pca(const ViewPcaModel& model, std::size_t first, std::size_t count,
                     std::span<double> out) {
  const BtfShape& shape = model.info.btf.shape;
  const std::size_t texels = shape.texels();
  const std::size_t light_channels = shape.lights * shape.channels;
  const std::vector<std::size_t> offsets = model.offsets();
  for (std::size_t image = first; image < first + count; ++image) {
    const std::size_t v = image / shape.lights;
    const std::size_t row = image % shape.lights * shape.channels;
    double* values = out.data() + (image - first) * shape.image_values();
    for (std::size_t c = 0; c < shape.channels; ++c) {
      for (std::size_t p = 0; p < texels; ++p) {
        values[p * shape.channels + c] = model.mean[v * light_channels + row + c];
      }
      for (std::size_t i = offsets[v]; i < offsets[v + 1]; ++i) {
        const double weight = model.basis[i * light_channels + row + c];
        const float* component = model.images.data() + i * texels;
        for (std::size_t p = 0; p < texels; ++p) {
          values[p * shape.channels + c] += weight * double{component[p]};
        }
      }
    }
  }
}

}  // namespace weft::reference
