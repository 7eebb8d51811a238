#include "weft/codecs/decompress.hpp"

#include <algorithm>
#include <vector>

#include "weft/btf/copy_images.hpp"
#include "weft/device/tile_stream.hpp"
#include "weft/error.hpp"
#include "weft/ops/tile.hpp"

namespace weft {

void decompress(Device& device, const Model& model, TileSink& sink, Job& job) {
  const BtfShape& shape = model.info.btf.shape;
  const BtfInfo& output = sink.info();
  check_same_shape(shape, output.shape);
  const Codec& codec = find_codec(model.info.codec);
  const std::size_t run = image_granule(shape);
  const std::size_t values = run * shape.image_values();
  const std::size_t bytes = values * size_of(output.dtype);

  MemoryPlan plan;
  plan.add("model on the device", codec.decoder_bytes(model));
  plan.add("decoded images", values * sizeof(float));
  plan.add("converted images", 4 * bytes);  // two runs on the device, two on the host
  job.plan(plan);

  const std::unique_ptr<DeviceDecoder> decoder = codec.decoder(device, model);
  Buffer decoded(device, values * sizeof(float), "decoded images");
  // Two runs are in hand: one being decoded, one being written.
  struct Slot {
    Buffer converted;
    std::vector<std::byte> host;
    Handle<cl_event> ready;
    std::size_t first = 0;
    std::size_t count = 0;
  };
  Slot slots[2];
  for (Slot& slot : slots) {
    slot.converted = Buffer(device, bytes, "converted images");
    slot.host.resize(bytes);
  }
  // However it ends, no copy may still be under way into `slots`.
  struct Finish {
    Device& device;
    ~Finish() { clFinish(device.queue()); }
  } const finish{device};

  const auto write_out = [&](Slot& slot) {
    if (slot.count == 0) return;
    {
      const StageTimer timer(job, "decode (waited for)");
      wait_for(slot.ready);
    }
    const StageTimer timer(job, "write", 0, static_cast<double>(slot.count * output.image_bytes()));
    sink.write(slot.first, slot.count,
               std::span(slot.host).first(slot.count * output.image_bytes()));
    job.advance("decompress", slot.first + slot.count, shape.images());
    slot.count = 0;
  };
  for (std::size_t first = 0, index = 0; first < shape.images(); first += run, ++index) {
    check_interrupt();
    Slot& slot = slots[index % 2];  // written out when the run after it was begun
    slot.first = first;
    slot.count = std::min(run, shape.images() - first);
    decoder->decode(first, slot.count, decoded);
    ops::transcode_tile(device, slot.count * shape.image_values(), decoded, model.info.btf.encoding,
                        output.encoding, output.dtype, slot.converted);
    slot.ready = device.read_later(slot.converted, 0,
                                   std::span(slot.host).first(slot.count * output.image_bytes()));
    job.stage("decode (waited for)").flops +=
        decoder->image_flops() * static_cast<double>(slot.count);
    write_out(slots[(index + 1) % 2]);
  }
  for (Slot& slot : slots) write_out(slot);
  const StageTimer timer(job, "write");
  sink.finish();
  device.finish();
}

}  // namespace weft
