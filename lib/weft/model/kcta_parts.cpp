#include "weft/model/kcta_parts.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "weft/error.hpp"
#include "weft/model/storage.hpp"
#include "weft/reference/mode_product.hpp"

namespace weft {

std::unique_ptr<KctaModel> expanded(const KctaModel& model, std::string_view modes) {
  const std::string option = fmt::format("--expand {}", modes);
  auto larger = std::make_unique<KctaModel>(model);
  larger->info.errors.reset();  // they were measured of the model as it was
  for (std::size_t at = 0; at < modes.size();) {
    const std::size_t end = std::min(modes.find(',', at), modes.size());
    const std::size_t n = model.groups.find(modes.substr(at, end - at), option);
    at = end + 1;
    if (n == model.mode) {
      fail_input("{}: mode {} is that of the clusters", option, model.groups.groups()[n].name);
    }
    if (!larger->has_factor(n)) continue;
    const std::size_t size = model.groups.groups()[n].size;
    const std::size_t axis = n < model.mode ? n + 1 : n;  // behind the core's R_m
    std::vector<std::size_t> sizes = larger->other_ranks();
    sizes.insert(sizes.begin(), larger->ranks[larger->mode]);
    const std::size_t values = larger->cores.size() / larger->clusters;
    std::vector<float> cores;
    for (std::size_t c = 0; c < larger->clusters; ++c) {
      const auto first = larger->cores.begin() + static_cast<std::ptrdiff_t>(c * values);
      const std::vector<double> Z(first, first + static_cast<std::ptrdiff_t>(values));
      const std::span<const float> U = larger->factor(n, c);
      const std::vector<double> product =
          reference::mode_product(sizes, axis, Z, size, std::vector<double>(U.begin(), U.end()));
      cores.insert(cores.end(), product.begin(), product.end());
    }
    larger->cores = std::move(cores);
    larger->ranks[n] = size;
    larger->global[n].clear();
    larger->local[n].clear();
    set_storage(*larger, Storage::f32);  // products are not halves
  }
  return larger;
}

}  // namespace weft
