#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

namespace hedgehop::global_planning {

/// Costs of edges that were evaluated, by a number of the edge that is not 0.
///
/// Open addressing with linear probing. When it is half full a table of twice the size takes over,
/// and each insertion moves a few old entries: none takes much longer than the others.
class EdgeTable {
 public:
  struct Entry {
    std::uint64_t edge;  // 0: free
    double cost_m;
    bool is_fine_checked;
  };

  explicit EdgeTable(unsigned size_bits = 16) : now_(size_bits) {}

  /// Null if the edge is not in the table; else valid until the next insertion.
  [[nodiscard]] Entry* find(std::uint64_t edge) {
    Entry* entry = &now_.slot_of(edge);
    if (entry->edge == edge) {
      return entry;
    }
    if (before_.slots == nullptr) {
      return nullptr;
    }
    entry = &before_.slot_of(edge);
    return entry->edge == edge ? entry : nullptr;
  }

  /// Adds an edge that is not in the table.
  Entry* insert(std::uint64_t edge, double cost_m) {
    if (2 * (used_ + 1) > now_.size()) {
      move(before_.size());
      before_ = static_cast<Slots&&>(now_);
      now_ = Slots(before_.bits + 1);
      moved_ = 0;
    }
    move(kMovedAtOnce);
    ++used_;
    Entry& entry = now_.slot_of(edge);
    entry = {edge, cost_m, false};
    return &entry;
  }

  [[nodiscard]] std::size_t size() const { return used_; }

 private:
  static constexpr std::size_t kMovedAtOnce = 16;
  struct Free {
    void operator()(Entry* slots) const { std::free(slots); }
  };
  struct Slots {
    Slots() = default;
    // Memory from calloc is not touched before it is used.
    explicit Slots(unsigned size_bits)
        : bits(size_bits),
          slots(static_cast<Entry*>(std::calloc(std::size_t{1} << size_bits, sizeof(Entry)))) {
      if (slots == nullptr) {
        throw std::bad_alloc();
      }
    }
    [[nodiscard]] std::size_t size() const { return slots == nullptr ? 0 : std::size_t{1} << bits; }
    /// Where the edge is, or the free slot where it belongs.
    [[nodiscard]] Entry& slot_of(std::uint64_t edge) const {
      const std::size_t mask = size() - 1;
      std::size_t slot = static_cast<std::size_t>((edge * 0x9e3779b97f4a7c15U) >> 20U) & mask;
      while (slots.get()[slot].edge != 0 && slots.get()[slot].edge != edge) {
        slot = (slot + 1) & mask;
      }
      return slots.get()[slot];
    }

    unsigned bits = 0;
    std::unique_ptr<Entry, Free> slots;
  };

  // The old copies stay, as others are found past them; the new ones are found first.
  void move(std::size_t count) {
    for (; before_.slots != nullptr && count > 0; --count) {
      if (moved_ == before_.size()) {
        before_ = Slots();
        return;
      }
      const Entry& entry = before_.slots.get()[moved_++];
      if (entry.edge == 0) {
        continue;
      }
      if (Entry& slot = now_.slot_of(entry.edge); slot.edge == 0) {
        slot = entry;
      }
    }
  }

  Slots now_;
  Slots before_;
  std::size_t moved_ = 0;  // slots of before_
  std::size_t used_ = 0;
};

}  // namespace hedgehop::global_planning
