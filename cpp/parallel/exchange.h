// Sparse personalised exchange: every rank sends fixed-width records to ranks of its choice.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <petscsys.h>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Routes records to ranks by point-to-point messages, so that the cost depends only on the ranks
/// that actually exchange messages.
///
/// Records arrive ordered by source rank, and in sending order within a rank. `reverse` returns one
/// answer per received record to its sender, in sending order.
class Exchange
{
public:
  /// Collective. @param comm communicator, must outlive the object
  /// @param dest rank that receives record i
  Exchange(MPI_Comm comm, std::span<const int> dest);
  ~Exchange();
  Exchange(const Exchange&) = delete;
  Exchange& operator=(const Exchange&) = delete;

  /// Number of records that this rank receives.
  std::size_t num_received() const { return num_received_; }

  /// Send records; collective. @param data `width` values per record, in the order of `dest`
  /// @return `width` values per received record
  template <typename T>
  std::vector<T> forward(std::span<const T> data, int width) const
  {
    const std::size_t bytes = sizeof(T) * static_cast<std::size_t>(width);
    std::vector<T> packed(order_.size() * width);
    for (std::size_t i = 0; i < order_.size(); ++i)
      std::copy_n(data.data() + static_cast<std::size_t>(order_[i]) * width, width,
                  packed.data() + i * width);
    std::vector<T> out(num_received_ * width);
    send(packed.data(), to_, out.data(), from_, bytes);
    return out;
  }

  /// Send one answer per received record back; collective.
  /// @return `width` values per record, in the order of `dest`
  template <typename T>
  std::vector<T> reverse(std::span<const T> data, int width) const
  {
    const std::size_t bytes = sizeof(T) * static_cast<std::size_t>(width);
    std::vector<T> packed(order_.size() * width), out;
    send(data.data(), from_, packed.data(), to_, bytes);
    out.resize(packed.size());
    for (std::size_t i = 0; i < order_.size(); ++i)
      std::copy_n(packed.data() + i * width, width,
                  out.data() + static_cast<std::size_t>(order_[i]) * width);
    return out;
  }

private:
  /// Records exchanged with one rank.
  struct Peer
  {
    int rank;
    int count;
    std::size_t offset; ///< first record
  };

  void send(const void* in, const std::vector<Peer>& targets, void* out,
            const std::vector<Peer>& sources, std::size_t record_bytes) const;
  static std::vector<Peer> peers(const std::map<int, int>& counts);

  MPI_Comm comm_ = MPI_COMM_NULL; // PETSc's duplicate, with a tag for this object alone
  PetscMPIInt tag_ = 0;
  std::vector<std::int32_t> order_; // records sorted by destination
  std::vector<Peer> to_, from_;
  std::size_t num_received_ = 0;
};

} // namespace qsdolfinx
