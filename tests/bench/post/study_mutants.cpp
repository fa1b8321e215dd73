// SPDX-License-Identifier: GPL-3.0-or-later
// Every single token of the programs of whole items changed once, through reading, rules, comparison and replay of the item.
//
//   study_mutants [PROGRAMS] [EVERY] [REPLAYS]     30 programs, every token, at most 2000 replays of mutants that the comparison names anyway
#include <cstdio>
#include <cstdlib>

#include "tests/support/item_mutants.hpp"

int main(int argc, char** argv) {
  using namespace asbuilt;
  const int programs = argc > 1 ? std::atoi(argv[1]) : 30;
  const std::size_t every = argc > 2 ? static_cast<std::size_t>(std::atoi(argv[2])) : 1;
  const int replays = argc > 3 ? std::atoi(argv[3]) : 2000;
  support::MutantCount count;
  for (int k = 0; k < programs; ++k) {
    const auto& table = posts();
    const Post& post = table[static_cast<std::size_t>(k) % 3];  // KRL, INFORM, Beckhoff CNC in turn
    support::count_mutants(count, support::subject_of(support::numbered_item(1 + k / 3), post), k, {.every = every, .replays_at_most = replays * (k + 1) / programs});
    std::fprintf(stderr, "%d of %d\n", k + 1, programs);
  }
  support::print(count);
  return count.unexplained.empty() ? 0 : 1;
}
