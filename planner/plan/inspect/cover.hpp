// SPDX-License-Identifier: GPL-3.0-or-later
// The fewest sets that cover what all of them together cover, and the shortest closed way over points: plain lists of numbers.
#pragma once

#include <cstdint>
#include <vector>

namespace asbuilt::inspecting {

/// One bit an element.
class Bits {
 public:
  explicit Bits(std::size_t size = 0) : size_(size), words_((size + 63) / 64) {}
  std::size_t size() const { return size_; }
  void set(std::size_t i) { words_[i / 64] |= std::uint64_t{1} << (i % 64); }
  bool test(std::size_t i) const { return (words_[i / 64] >> (i % 64)) & 1; }
  std::size_t count() const;
  std::size_t count_beyond(const Bits& other) const;  // set here and not there
  void add(const Bits& other);

 private:
  std::size_t size_ = 0;
  std::vector<std::uint64_t> words_;
};

/// Indices of the chosen sets, in the order chosen. Greedy (within 1 + ln n of the fewest), then what the others cover as well is
/// taken out again, dearest first, then pairs that one unused set can stand in for are replaced by it. `price` breaks ties; equal
/// prices: the lower index. `is_allowed`: 0 for sets that may not be used.
std::vector<int> cover(const std::vector<Bits>& sets, const std::vector<double>& price, const std::vector<char>& is_allowed);

/// Order of 1..n-1 on the shortest closed way from 0 back to 0. `cost` is n x n, symmetric. Exact (Held, Karp 1962) up to 12 points;
/// beyond, nearest neighbour, then 2-opt and moving of runs of up to three until nothing gets shorter.
std::vector<int> closed_tour(const std::vector<std::vector<double>>& cost);
double tour_cost(const std::vector<std::vector<double>>& cost, const std::vector<int>& order);

}  // namespace asbuilt::inspecting
