// SPDX-License-Identifier: GPL-3.0-or-later
// The fuzz target without libFuzzer, for compilers that lack it: mutations of the files of a folder, the same ones for the same seed.
// mutate_step DIR COUNT [SEED]: before each run the bytes stand in mutate_step.last, so that a crash or a hang leaves them behind.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "planner/base/random.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

int main(int argc, char** argv) {
  if (argc < 3) return std::puts("mutate_step DIR COUNT [SEED]"), 2;
  std::vector<std::string> seeds;
  std::vector<std::filesystem::path> paths;
  for (const auto& e : std::filesystem::directory_iterator(argv[1])) paths.push_back(e.path());
  std::sort(paths.begin(), paths.end());
  for (const auto& p : paths) {
    std::ifstream in(p, std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(in), {}};
    if (bytes.size() > 100 && bytes.size() < 400000) seeds.push_back(std::move(bytes));
  }
  if (seeds.empty()) return std::puts("no seeds"), 2;
  static const char* const words[] = {
      "#1",     "#0",         "$",       "*",       ".T.",    ".F.", "()", "1E308", "-1.", "0.", "1e-300", "9999999999999",
      "PLANE(", "CIRCLE('',", ".MILLI.", ".HECTO.", ".PICO.", "''",  ";",  ")",     "(",   ",,"};
  asbuilt::Random random(argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1);
  double worst_s = 0;
  const long count = std::atol(argv[2]);
  for (long k = 0; k < count; ++k) {
    std::string m = seeds[random.below(seeds.size())];
    const std::size_t changes = 1 + random.below(8);
    for (std::size_t c = 0; c < changes; ++c) {
      const std::size_t at = random.below(m.size());
      switch (random.below(8)) {
        case 0:
          m[at] = static_cast<char>(random.below(256));
          break;
        case 1:
          m.erase(at, 1 + random.below(60));
          break;
        case 2:
          m.insert(at, m.substr(random.below(m.size()), random.below(200)));
          break;
        case 3:
          m[at] = "0123456789.#,()'$*E-"[random.below(20)];
          break;
        case 4:
          m.insert(at, words[random.below(std::size(words))]);
          break;
        case 5:
          m.resize(std::max<std::size_t>(101, at));
          break;
        default:  // another reference, or another number
          if (const std::size_t h = m.find_first_of(random.below(2) ? "#" : "(", at); h != std::string::npos && h + 2 < m.size())
            m.replace(h + 1, 1 + random.below(3), std::to_string(random.below(4000)));
      }
      if (m.size() < 101) break;
    }
    std::ofstream("mutate_step.last", std::ios::binary) << m;
    const auto t0 = std::chrono::steady_clock::now();
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(m.data()), m.size());
    const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count();
    if (s > worst_s) worst_s = s, std::printf("%ld: %.1f s\n", k, s), std::fflush(stdout);
  }
  std::printf("%ld mutations of %zu files, slowest %.1f s\n", count, seeds.size(), worst_s);
  return 0;
}
