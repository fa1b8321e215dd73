// SPDX-License-Identifier: GPL-3.0-or-later
// Keyword texts to numbers: the known ones first, others as the file brings them.
#pragma once

#include <cstdint>
#include <cstring>
#include <string_view>
#include <vector>

#include "planner/io/step/keywords.hpp"

namespace asbuilt::p21 {

/// Open addressing over keyword texts; the known ones come first.
class Keywords {
 public:
  Keywords() : slots_(1024, 0) {
    for (std::uint32_t k = 0; k < K_known_count; ++k)
      names_.push_back(known_keyword(k)), put(static_cast<std::uint32_t>(names_.size()) - 1);
  }
  std::uint32_t id(std::string_view text) {
    std::size_t i = hash(text) & (slots_.size() - 1);
    while (slots_[i]) {
      if (names_[slots_[i] - 1] == text) return slots_[i] - 1;
      i = (i + 1) & (slots_.size() - 1);
    }
    if (names_.size() >= 60000) return 60000;  // hostile input: one shared name for the rest
    names_.push_back(text);
    if (2 * names_.size() > slots_.size()) {
      slots_.assign(2 * slots_.size(), 0);
      for (std::uint32_t k = 0; k < names_.size(); ++k) put(k);
    } else {
      slots_[i] = static_cast<std::uint32_t>(names_.size());
    }
    return static_cast<std::uint32_t>(names_.size()) - 1;
  }
  std::vector<std::string_view> extra() const { return {names_.begin() + K_known_count, names_.end()}; }

 private:
  static std::size_t hash(std::string_view s) {
    std::uint64_t h = s.size() * 0x9E3779B97F4A7C15ull;
    if (s.size() >= 8) {
      std::uint64_t a, b;
      std::memcpy(&a, s.data(), 8), std::memcpy(&b, s.data() + s.size() - 8, 8);
      h ^= a * 0xff51afd7ed558ccdull, h ^= b * 0xc4ceb9fe1a85ec53ull;
      if (s.size() > 16) {
        std::memcpy(&a, s.data() + s.size() / 2 - 4, 8);
        h += a * 0x2545F4914F6CDD1Dull;
      }
    } else {
      for (char c : s) h = (h ^ static_cast<std::uint8_t>(c)) * 0x100000001b3ull;
    }
    return static_cast<std::size_t>(h ^ (h >> 29));
  }
  void put(std::uint32_t k) {
    std::size_t i = hash(names_[k]) & (slots_.size() - 1);
    while (slots_[i]) i = (i + 1) & (slots_.size() - 1);
    slots_[i] = k + 1;
  }
  std::vector<std::string_view> names_;
  std::vector<std::uint32_t> slots_;
};

}  // namespace asbuilt::p21
