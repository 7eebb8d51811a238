// EXR by OpenEXR, single part, half or float.
//
// The header is walked here before the library sees the file, because the library believes the
// sizes it finds there: attributes must lie within the file, and the data window must be of a sane
// size.
#include <Iex.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "weft/error.hpp"
#include "weft/io/image_formats.hpp"

namespace weft::formats {
namespace {

constexpr std::array<unsigned char, 4> magic{0x76, 0x2f, 0x31, 0x01};
constexpr std::uint32_t deep_flag = 0x800;
constexpr std::uint32_t multi_part_flag = 0x1000;
// The lossy block codes shrink flat images without bound; the limit on decoded bytes stands anyway.
constexpr std::size_t max_ratio = 1 << 16;
constexpr std::size_t longest_name = 255;

std::uint32_t little_endian(Bytes bytes, std::size_t offset) {
  std::uint32_t value = 0;
  for (std::size_t i = 4; i-- > 0;) {
    value = value << 8 | std::to_integer<std::uint32_t>(bytes[offset + i]);
  }
  return value;
}

class MemoryInput : public Imf::IStream {
 public:
  MemoryInput(Bytes file, const std::string& name) : IStream(name.c_str()), file_(file) {}

  bool isMemoryMapped() const override { return false; }

  bool read(char to[], int count) override {
    if (count < 0 || position_ > file_.size() ||
        static_cast<std::size_t>(count) > file_.size() - position_) {
      throw Iex::InputExc("the file ends early");
    }
    std::memcpy(to, file_.data() + position_, static_cast<std::size_t>(count));
    position_ += static_cast<std::size_t>(count);
    return position_ < file_.size();
  }

  std::uint64_t tellg() override { return position_; }
  void seekg(std::uint64_t position) override { position_ = position; }

 private:
  Bytes file_;
  std::uint64_t position_ = 0;
};

class MemoryOutput : public Imf::OStream {
 public:
  explicit MemoryOutput(const std::string& name) : OStream(name.c_str()) {}

  void write(const char from[], int count) override {
    const auto length = static_cast<std::size_t>(count);
    if (position_ + length > bytes_.size()) bytes_.resize(position_ + length);
    std::memcpy(bytes_.data() + position_, from, length);
    position_ += length;
  }

  std::uint64_t tellp() override { return position_; }
  void seekp(std::uint64_t position) override { position_ = position; }

  std::vector<std::byte> take() { return std::move(bytes_); }

 private:
  std::vector<std::byte> bytes_;
  std::size_t position_ = 0;
};

// Walks the attributes of one header from `offset`; returns the offset behind it.
class HeaderWalk {
 public:
  HeaderWalk(Bytes file, const std::string& name) : file_(file), name_(name) {}

  struct Window {
    std::int32_t min_x = 0, min_y = 0, max_x = 0, max_y = 0;
  };

  std::size_t walk(std::size_t offset) {
    while (true) {
      const std::string attribute = text(offset);
      if (attribute.empty()) return offset;
      text(offset);  // its type
      if (file_.size() - offset < 4) fail_short();
      const std::size_t size = little_endian(file_, offset);
      offset += 4;
      if (size > file_.size() - offset) {
        fail_input("{}: damaged EXR: attribute '{}' claims {} bytes of {}", name_, attribute, size,
                   file_.size() - offset);
      }
      if (attribute == "dataWindow") {
        if (size != 16) fail_input("{}: damaged EXR: dataWindow of {} bytes", name_, size);
        found_window_ = true;
        window_ = {coordinate(offset), coordinate(offset + 4), coordinate(offset + 8),
                   coordinate(offset + 12)};
      }
      offset += size;
    }
  }

  const Window& window() const {
    if (!found_window_) fail_input("{}: damaged EXR: no dataWindow", name_);
    return window_;
  }

 private:
  std::string text(std::size_t& offset) const {
    std::string value;
    while (true) {
      if (offset >= file_.size()) fail_short();
      const char c = std::to_integer<char>(file_[offset++]);
      if (c == '\0') return value;
      if (value.size() == longest_name) fail_input("{}: damaged EXR: endless name", name_);
      value.push_back(c);
    }
  }
  std::int32_t coordinate(std::size_t offset) const {
    return static_cast<std::int32_t>(little_endian(file_, offset));
  }
  [[noreturn]] void fail_short() const { fail_input("{}: damaged EXR: ends in its header", name_); }

  Bytes file_;
  const std::string& name_;
  bool found_window_ = false;
  Window window_;
};

std::size_t length(std::int32_t first, std::int32_t last, const std::string& name) {
  const std::int64_t size = std::int64_t{last} - first + 1;
  if (size < 1) fail_input("{}: damaged EXR: data window from {} to {}", name, first, last);
  return static_cast<std::size_t>(size);
}

// Which channels of the file make the image, in order.
struct Layout {
  ImageInfo info;
  std::vector<std::string> channels;
};

// The channels' names of one layer, without the layer's name.
using Layers = std::map<std::string, std::vector<std::string>>;

bool has(const std::vector<std::string>& names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// R,G,B; or Y; or C0, C1, ... as the writer names them; empty if the layer is none of these.
std::vector<std::string> colour_channels(const std::vector<std::string>& names,
                                         const std::string& file) {
  if (has(names, "R") && has(names, "G") && has(names, "B")) return {"R", "G", "B"};
  if (has(names, "Y")) {
    if (has(names, "RY") || has(names, "BY")) {
      fail_input("{}: luminance-chroma EXR (Y, RY, BY) is not read", file);
    }
    if (has(names, "X") && has(names, "Z")) fail_input("{}: XYZ colour is not read", file);
    return {"Y"};
  }
  std::vector<std::string> numbered;
  while (has(names, fmt::format("C{}", numbered.size()))) {
    numbered.push_back(fmt::format("C{}", numbered.size()));
  }
  return numbered;
}

Layout channel_layout(const Imf::ChannelList& list, const std::string& file) {
  Layers layers;
  std::string all;
  for (auto channel = list.begin(); channel != list.end(); ++channel) {
    const std::string name = channel.name();
    const std::size_t dot = name.rfind('.');
    if (dot == std::string::npos) {
      layers[""].push_back(name);
    } else {
      layers[name.substr(0, dot)].push_back(name.substr(dot + 1));
    }
    all += (all.empty() ? "" : ", ") + name;
  }
  // The image without a layer's name goes first; else the one layer that holds an image.
  Layout layout;
  std::vector<std::string> candidates;
  for (const auto& [layer, names] : layers) {
    std::vector<std::string> colours = colour_channels(names, file);
    if (colours.empty()) continue;
    candidates.push_back(layer);
    if (candidates.size() > 1) continue;
    for (const std::string& colour : colours) {
      layout.channels.push_back(layer.empty() ? colour : layer + "." + colour);
    }
  }
  if (candidates.empty()) {
    fail_input("{}: no channels R, G, B or Y among: {}", file, all.empty() ? "none" : all);
  }
  if (!candidates.front().empty() && candidates.size() > 1) {
    fail_input("{}: several layers with an image: {}, {}", file, candidates[0], candidates[1]);
  }
  layout.info.channels = layout.channels.size();
  layout.info.dtype = DType::f16;
  for (const std::string& name : layout.channels) {
    const Imf::Channel& channel = list[name.c_str()];
    if (channel.xSampling != 1 || channel.ySampling != 1) {
      fail_input("{}: channel {} is subsampled by {} x {}", file, name, channel.xSampling,
                 channel.ySampling);
    }
    if (channel.type == Imf::UINT) {
      fail_input("{}: channel {} holds integers; half or float is read", file, name);
    }
    if (channel.type == Imf::FLOAT) layout.info.dtype = DType::f32;
  }
  return layout;
}

Layout parse(Bytes file, const std::string& name) {
  if (file.size() < 8) fail_input("{}: damaged EXR: {} bytes", name, file.size());
  const std::uint32_t version = little_endian(file, 4);
  if ((version & deep_flag) != 0) fail_input("{}: deep EXR images are not read", name);
  HeaderWalk walk(file, name);
  const std::size_t end = walk.walk(8);
  if ((version & multi_part_flag) != 0 && (end >= file.size() || file[end] != std::byte{0})) {
    fail_input("{}: an EXR of several parts is not read", name);
  }
  const HeaderWalk::Window& window = walk.window();
  const std::size_t width = length(window.min_x, window.max_x, name);
  const std::size_t height = length(window.min_y, window.max_y, name);
  check_size(name, width, height, sizeof(float), file.size(), max_ratio);
  try {
    MemoryInput stream(file, name);
    stream.seekg(8);
    Imf::Header header;
    int library_version = static_cast<int>(version);
    header.readFrom(stream, library_version);
    Layout layout = channel_layout(header.channels(), name);
    layout.info.width = width;
    layout.info.height = height;
    check_size(name, width, height, layout.info.channels * size_of(layout.info.dtype), file.size(),
               max_ratio);
    return layout;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    fail_input("{}: damaged EXR: {}", name, error.what());
  }
}

Imf::PixelType pixel_type(DType dtype) {
  return dtype == DType::f16 ? Imf::HALF : Imf::FLOAT;
}

}  // namespace

bool is_exr(Bytes file) {
  return file.size() >= magic.size() && std::memcmp(file.data(), magic.data(), magic.size()) == 0;
}

ImageInfo exr_info(Bytes file, const std::string& name) {
  return parse(file, name).info;
}

void read_exr(Bytes file, const std::string& name, const ImageInfo& info,
              std::span<std::byte> out) {
  const Layout layout = parse(file, name);
  try {
    MemoryInput stream(file, name);
    Imf::InputFile input(stream, 0);
    const Imath::Box2i window = input.header().dataWindow();
    const std::size_t value_bytes = size_of(info.dtype);
    const std::size_t stride = info.channels * value_bytes;
    Imf::FrameBuffer frame;
    for (std::size_t c = 0; c < layout.channels.size(); ++c) {
      frame.insert(layout.channels[c].c_str(),
                   Imf::Slice::Make(pixel_type(info.dtype), out.data() + c * value_bytes, window,
                                    stride, stride * info.width));
    }
    input.setFrameBuffer(frame);
    input.readPixels(window.min.y, window.max.y);
  } catch (const std::exception& error) {
    fail_input("{}: damaged EXR: {}", name, error.what());
  }
}

std::vector<std::byte> encode_exr(const std::string& name, const ImageInfo& info, Bytes values,
                                  ExrCompression compression,
                                  std::span<const std::string> channel_names) {
  if (info.dtype != DType::f16 && info.dtype != DType::f32) {
    fail_runtime("{}: EXR holds F16 or F32, not {}", name, name_of(info.dtype));
  }
  if (info.width > max_image_side || info.height > max_image_side) {
    fail_runtime("{}: {} x {} is too large for an image", name, info.width, info.height);
  }
  // Name the channels.
  std::vector<std::string> names(channel_names.begin(), channel_names.end());
  if (info.channels == 3) {
    names = {"R", "G", "B"};
  } else if (info.channels == 1) {
    names = {"Y"};
  } else if (names.size() != info.channels) {
    names.clear();
    for (std::size_t c = 0; c < info.channels; ++c) names.push_back(fmt::format("C{}", c));
  }
  constexpr std::array codes{Imf::NO_COMPRESSION, Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION};
  try {
    Imf::Header header(static_cast<int>(info.width), static_cast<int>(info.height));
    header.compression() = codes[static_cast<std::size_t>(compression)];
    const Imath::Box2i window = header.dataWindow();
    const std::size_t value_bytes = size_of(info.dtype);
    const std::size_t stride = info.channels * value_bytes;
    Imf::FrameBuffer frame;
    for (std::size_t c = 0; c < info.channels; ++c) {
      header.channels().insert(names[c].c_str(), Imf::Channel(pixel_type(info.dtype)));
      frame.insert(names[c].c_str(),
                   Imf::Slice::Make(pixel_type(info.dtype), values.data() + c * value_bytes, window,
                                    stride, stride * info.width));
    }
    MemoryOutput stream(name);
    {
      // The table of lines is written as the file object ends.
      Imf::OutputFile output(stream, header, 0);
      output.setFrameBuffer(frame);
      output.writePixels(static_cast<int>(info.height));
    }
    return stream.take();
  } catch (const std::exception& error) {
    fail_runtime("{}: EXR can't be encoded: {}", name, error.what());
  }
}

}  // namespace weft::formats
