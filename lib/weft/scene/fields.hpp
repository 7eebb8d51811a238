// The parameters of simulated materials, each described once: its name, its range and what it
// means. Whoever walks over them decides what is done: values are checked, read from JSON, listed.
//
//   void describe(Fields& fields, Leather& leather) {
//     fields.number("cell_size", leather.cell_size, 0.1, 10, "mean width of a cell");
//     ...
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "weft/scene/reflectance.hpp"

namespace weft {

class Fields {
 public:
  Fields() = default;
  Fields(const Fields&) = delete;
  Fields& operator=(const Fields&) = delete;
  virtual ~Fields() = default;

  // A number of [low, high].
  virtual void number(std::string_view name, double& value, double low, double high,
                      std::string_view meaning) = 0;
  void number(std::string_view name, float& value, double low, double high,
              std::string_view meaning);
  // A whole number of [low, high].
  virtual void count(std::string_view name, std::size_t& value, std::size_t low, std::size_t high,
                     std::string_view meaning) = 0;
  virtual void seed(std::uint64_t& value) = 0;
  // Three numbers of [0, 1], linear light.
  virtual void color(std::string_view name, std::array<float, 3>& value,
                     std::string_view meaning) = 0;
  // Width and depth of the tile.
  virtual void tile(std::array<double, 2>& value, double low, double high,
                    std::string_view meaning) = 0;

  // What follows, up to `close`, are the fields of an object called `name`.
  virtual void open(std::string_view name, std::string_view meaning) = 0;
  virtual void close() = 0;

  // The size that a list of objects shall have, given the one it has; open_item(i) to close() for
  // each of them follow, and then close() for the list.
  virtual std::size_t open_list(std::string_view name, std::size_t size, std::size_t least,
                                std::size_t most, std::string_view meaning) = 0;
  virtual void open_item(std::size_t index) = 0;
};

// f0, f90, alpha_along and alpha_across, as an object.
void describe_gloss(Fields& fields, GlossyLobe& gloss);

template <typename Item>
void describe_list(Fields& fields, std::string_view name, std::vector<Item>& items,
                   std::size_t least, std::size_t most, std::string_view meaning) {
  items.resize(fields.open_list(name, items.size(), least, most, meaning));
  for (std::size_t i = 0; i < items.size(); ++i) {
    fields.open_item(i);
    describe(fields, items[i]);
    fields.close();
  }
  fields.close();
}

// The dotted path of the field that is walked over: "warp.gloss.f90", "stones[2].color".
class FieldPath {
 public:
  void push(std::string_view name);
  void push(std::size_t index);
  void pop() { parts_.pop_back(); }
  std::string of(std::string_view name) const;
  std::string text() const;
  std::size_t depth() const { return parts_.size(); }

 private:
  std::vector<std::string> parts_;
};

// Throws an input error that names `what`, the field and the value where one is out of its range.
class FieldChecker final : public Fields {
 public:
  explicit FieldChecker(std::string_view what) : what_(what) {}
  using Fields::number;
  void number(std::string_view name, double& value, double low, double high,
              std::string_view meaning) override;
  void count(std::string_view name, std::size_t& value, std::size_t low, std::size_t high,
             std::string_view meaning) override;
  void seed(std::uint64_t& /*value*/) override {}
  void color(std::string_view name, std::array<float, 3>& value, std::string_view meaning) override;
  void tile(std::array<double, 2>& value, double low, double high,
            std::string_view meaning) override;
  void open(std::string_view name, std::string_view /*meaning*/) override { path_.push(name); }
  void close() override { path_.pop(); }
  std::size_t open_list(std::string_view name, std::size_t size, std::size_t least,
                        std::size_t most, std::string_view meaning) override;
  void open_item(std::size_t index) override { path_.push(index); }

 private:
  std::string what_;
  FieldPath path_;
};

// Checks all that `describe` names in a material of a kind.
template <typename Parameters>
void check_fields(std::string_view kind, const Parameters& parameters) {
  Parameters copy = parameters;
  FieldChecker checker(kind);
  describe(checker, copy);
}

// What a field accepts, in words, as for a table.
struct FieldRow {
  std::string path, accepts, standard, meaning;
};

// Lists all fields with the values they have.
class FieldLister final : public Fields {
 public:
  using Fields::number;
  void number(std::string_view name, double& value, double low, double high,
              std::string_view meaning) override;
  void count(std::string_view name, std::size_t& value, std::size_t low, std::size_t high,
             std::string_view meaning) override;
  void seed(std::uint64_t& value) override;
  void color(std::string_view name, std::array<float, 3>& value, std::string_view meaning) override;
  void tile(std::array<double, 2>& value, double low, double high,
            std::string_view meaning) override;
  void open(std::string_view name, std::string_view meaning) override;
  void close() override { path_.pop(); }
  std::size_t open_list(std::string_view name, std::size_t size, std::size_t least,
                        std::size_t most, std::string_view meaning) override;
  void open_item(std::size_t /*index*/) override { path_.push(""); }

  const std::vector<FieldRow>& rows() const { return rows_; }

 private:
  void add(std::string_view name, std::string accepts, std::string standard,
           std::string_view meaning);

  std::vector<FieldRow> rows_;
  FieldPath path_;
};

}  // namespace weft
