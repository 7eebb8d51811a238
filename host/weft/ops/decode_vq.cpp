#include "weft/ops/decode_vq.hpp"

#include <fmt/core.h>

#include <array>
#include <bit>
#include <span>
#include <string>

#include "weft/ops/launch.hpp"

namespace weft::ops {
namespace {

constexpr std::size_t place_words = 6;
constexpr std::size_t block = 64;  // entries or texels that a work-item decodes

template <typename T>
Buffer upload(Device& device, std::span<const T> values, const char* what) {
  // kernels are given a buffer where a model has no chromaticities, too
  Buffer buffer(device, std::max<std::size_t>(values.size(), 1) * sizeof(T), what);
  if (!values.empty()) device.write(buffer, values);
  return buffer;
}

Buffer upload(Device& device, const PackedIndices& indices, const char* what) {
  return upload(device, indices.indices(), what);
}

Buffer upload(Device& device, const std::vector<float>& values, const char* what) {
  return upload(device, std::span<const float>(values), what);
}

// The words of a place's view, phi and theta, or of its light, alpha and beta.
void put_place(const VqPlace& place, std::size_t level, std::uint32_t* words) {
  for (std::size_t i = 0; i < 2; ++i) {
    const OnionStep& step = place[level + i];
    words[2 * i] = static_cast<std::uint32_t>(step.low);
    words[2 * i + 1] = static_cast<std::uint32_t>(step.high);
    words[4 + i] = std::bit_cast<std::uint32_t>(static_cast<float>(step.fraction));
  }
}

template <typename... Args>
void set_book_arguments(cl_kernel kernel, const VqTables& tables, const Args&... args) {
  const auto word = [](std::size_t size) { return static_cast<std::uint32_t>(size); };
  const OnionSizes& n = tables.grid;
  set_arguments(kernel, word(n.phi), word(n.theta), word(n.alpha), word(n.beta), tables.P4,
                tables.c_P4, tables.P3, tables.c_P3, tables.M, tables.P2, tables.c_P2, tables.P1,
                tables.I2, tables.I1, tables.C, args...);
}

}  // namespace

VqTables::VqTables(Device& device, const VqModel& model)
    : grid(model.grid.sizes),
      shape(model.info.btf.shape),
      chromaticities(model.chromaticities),
      size(model.sizes.p4) {
  P4 = upload(device, model.p4.entries, "code-book P4");
  c_P4 = upload(device, model.p4.scales, "scales of P4");
  P3 = upload(device, model.p3.entries, "code-book P3");
  c_P3 = upload(device, model.p3.scales, "scales of P3");
  M = upload(device, model.m, "code-book M");
  P2 = upload(device, model.p2.entries, "code-book P2");
  c_P2 = upload(device, model.p2.scales, "scales of P2");
  P1 = upload(device, model.p1, "code-book P1");
  I2 = upload(device, model.i2, "code-book I2");
  I1 = upload(device, model.i1, "code-book I1");
  C = upload(device, model.c, "code-book C");
  P6 = upload(device, model.p6.entries, "planar index");
  c_P6 = upload(device, model.p6.scales, "scales of texels");
  const std::vector<std::uint32_t> kept(model.channels.begin(), model.channels.end());
  channels = upload(device, std::span<const std::uint32_t>(kept), "channels");

  std::vector<std::uint32_t> of_views(shape.views * place_words);
  std::vector<std::uint32_t> of_lights(shape.images() * place_words);
  for (std::size_t image = 0; image < shape.images(); ++image) {
    const std::size_t view = image / shape.lights;
    const VqPlace place = vq_place(model.grid, model.info.btf, view, image % shape.lights);
    put_place(place, 0, of_views.data() + view * place_words);
    put_place(place, 2, of_lights.data() + image * place_words);
  }
  views = upload(device, std::span<const std::uint32_t>(of_views), "places of views");
  lights = upload(device, std::span<const std::uint32_t>(of_lights), "places of lights");
}

std::size_t VqTables::bytes(const VqModel& model) {
  const BtfShape& shape = model.info.btf.shape;
  const OnionSizes& n = model.grid.sizes;
  const auto& s = model.sizes;
  const std::size_t words = 2 * (s.p4 * n.phi + s.p3 * n.theta + s.p2 * n.alpha + shape.texels()) +
                            s.m * 2 + s.p1 * n.beta + s.i2 * n.alpha + s.i1 * n.beta +
                            s.c * model.chromaticities + shape.channels +
                            place_words * (shape.views + shape.images()) + 3;
  return words * sizeof(float);
}

std::size_t vq_entry_floats(const VqTables& tables, std::size_t images) {
  return images * tables.size * (1 + tables.chromaticities);
}

void decode_vq(Device& device, const VqTables& tables, std::size_t first, std::size_t images,
               Buffer& entries, Buffer& out) {
  if (images == 0) return;
  const std::string options = fmt::format("-DCOLOURS={} -DCHANNELS={} -DBLOCK={}",
                                          tables.chromaticities, tables.shape.channels, block);
  const cl_kernel values = device.kernel(kernel_sources::decode_vq, options, "vq_entries");
  set_book_arguments(values, tables, ulong(tables.shape.lights), ulong(first), ulong(tables.size),
                     tables.views, tables.lights, entries);
  launch_items(device, values, ceil_div(tables.size, block), images);
  const cl_kernel texels = device.kernel(kernel_sources::decode_vq, options, "vq_texels");
  set_arguments(texels, ulong(tables.shape.texels()), ulong(tables.size), tables.P6, tables.c_P6,
                tables.channels, entries, out);
  launch_items(device, texels, ceil_div(tables.shape.texels(), block), images);
}

void look_up_vq(Device& device, const LookupBatch& batch, const VqTables& tables) {
  const cl_kernel kernel = device.kernel(
      kernel_sources::look_up_vq,
      fmt::format("{} -DCOLOURS={}", lookup_options(device, batch.lookup, batch.shape.channels),
                  tables.chromaticities),
      "look_up_vq");
  set_book_arguments(kernel, tables, ulong(batch.count), ulong(tables.shape.lights), batch.lookups,
                     tables.views, tables.lights, tables.P6, tables.c_P6, tables.channels,
                     batch.out);
  launch_items(device, kernel, ceil_div(batch.count, lookup_block(device)));
}

double vq_entry_flops(const VqTables& tables) {
  const OnionSizes& n = tables.grid;
  double nodes = 1;
  for (const std::size_t size : {n.phi, n.theta, n.alpha, n.beta}) nodes *= size > 1 ? 2 : 1;
  return nodes * (4.0 + 2.0 * static_cast<double>(1 + tables.chromaticities));
}

}  // namespace weft::ops
