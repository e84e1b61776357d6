// Numbers for keys.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace qsdolfinx
{

/// Numbers keys in the order of their first appearance: a hash table with open addressing.
class KeyNumbers
{
public:
  explicit KeyNumbers(std::size_t expected = 0)
      : keys_(std::bit_ceil(2 * expected + 16), -1), numbers_(keys_.size())
  {
  }

  /// Number of a key that is not negative; size() - 1 if it is new.
  std::int32_t operator()(std::int64_t key)
  {
    if (2 * size_ >= keys_.size())
      grow();
    const std::size_t i = find(key);
    if (keys_[i] < 0)
    {
      keys_[i] = key;
      numbers_[i] = static_cast<std::int32_t>(size_++);
    }
    return numbers_[i];
  }

  std::size_t size() const { return size_; }

private:
  std::size_t find(std::int64_t key) const
  {
    // Fibonacci hashing, because the unknowns of a surface may have a constant stride.
    const std::size_t mask = keys_.size() - 1;
    const std::uint64_t hash = static_cast<std::uint64_t>(key) * 0x9E3779B97F4A7C15u;
    std::size_t i = (hash >> 32) & mask;
    while (keys_[i] >= 0 && keys_[i] != key)
      i = (i + 1) & mask;
    return i;
  }

  void grow()
  {
    KeyNumbers larger(keys_.size());
    for (std::size_t i = 0; i < keys_.size(); ++i)
      if (keys_[i] >= 0)
      {
        const std::size_t to = larger.find(keys_[i]);
        larger.keys_[to] = keys_[i];
        larger.numbers_[to] = numbers_[i];
      }
    keys_.swap(larger.keys_);
    numbers_.swap(larger.numbers_);
  }

  std::vector<std::int64_t> keys_;
  std::vector<std::int32_t> numbers_;
  std::size_t size_ = 0;
};

} // namespace qsdolfinx
