// SPDX-License-Identifier: GPL-3.0-or-later
// Random numbers that are the same on every machine and library: own distributions over std::mt19937_64.
#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <string_view>

namespace asbuilt {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  /// An independent stream for a named purpose (FNV-1a of the name mixed into the seed).
  static Random stream(std::uint64_t seed, std::string_view purpose) {
    std::uint64_t h = 1469598103934665603ull ^ (seed * 0x9E3779B97F4A7C15ull);
    for (char c : purpose) h = (h ^ static_cast<unsigned char>(c)) * 1099511628211ull;
    return Random(h);
  }
  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }
  double uniform(double lo, double hi) { return lo + (hi - lo) * uniform(); }
  std::uint64_t below(std::uint64_t n) { return static_cast<std::uint64_t>(uniform() * static_cast<double>(n)); }
  /// Standard normal (Box and Muller).
  double normal() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    double u = uniform();
    if (u < 1e-300) u = 1e-300;
    const double r = std::sqrt(-2 * std::log(u)), a = 6.283185307179586 * uniform();
    spare_ = r * std::sin(a);
    has_spare_ = true;
    return r * std::cos(a);
  }
  double normal(double mean, double sd) { return mean + sd * normal(); }

 private:
  std::mt19937_64 engine_;
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace asbuilt
