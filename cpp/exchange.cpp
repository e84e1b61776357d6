#include "exchange.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <numeric>

using namespace qsdolfinx;

namespace
{
/// Numbers of records that other ranks will send to this one: the non-blocking consensus algorithm
/// of Hoefler, Siebert and Lumsdaine (2010), which needs no array of the communicator's size.
std::map<int, int> discover_sources(MPI_Comm comm, const std::map<int, int>& counts_to)
{
  // Successive calls use different tags: a fast rank may already send for the next exchange.
  static int call = 0;
  const int tag = 4200 + (call++ % 1024);

  std::vector<MPI_Request> sends(counts_to.size());
  std::size_t i = 0;
  for (const auto& [rank, count] : counts_to)
    MPI_Issend(&count, 1, MPI_INT, rank, tag, comm, &sends[i++]);

  std::map<int, int> counts_from;
  MPI_Request barrier = MPI_REQUEST_NULL;
  bool in_barrier = false;
  for (int done = 0; !done;)
  {
    int arrived = 0;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, tag, comm, &arrived, &status);
    if (arrived)
      MPI_Recv(&counts_from[status.MPI_SOURCE], 1, MPI_INT, status.MPI_SOURCE, tag, comm,
               MPI_STATUS_IGNORE);
    if (in_barrier)
      MPI_Test(&barrier, &done, MPI_STATUS_IGNORE);
    else
    {
      int all_sent = 0;
      MPI_Testall(static_cast<int>(sends.size()), sends.data(), &all_sent, MPI_STATUSES_IGNORE);
      if (all_sent)
      {
        MPI_Ibarrier(comm, &barrier);
        in_barrier = true;
      }
    }
  }
  return counts_from;
}

std::vector<int> offsets_of(const std::vector<int>& counts)
{
  std::vector<int> offsets(counts.size() + 1, 0);
  std::partial_sum(counts.begin(), counts.end(), offsets.begin() + 1);
  return offsets;
}
} // namespace

Exchange::Exchange(MPI_Comm comm, std::span<const int> dest) : order_(dest.size())
{
  std::iota(order_.begin(), order_.end(), 0);
  std::stable_sort(order_.begin(), order_.end(), [&](auto a, auto b) { return dest[a] < dest[b]; });
  std::map<int, int> counts_to;
  for (int rank : dest)
    ++counts_to[rank];
  const std::map<int, int> counts_from = discover_sources(comm, counts_to);

  std::vector<int> to, from;
  for (const auto& [rank, count] : counts_to)
  {
    to.push_back(rank);
    send_counts_.push_back(count);
  }
  for (const auto& [rank, count] : counts_from)
  {
    from.push_back(rank);
    recv_counts_.push_back(count);
  }
  send_offsets_ = offsets_of(send_counts_);
  recv_offsets_ = offsets_of(recv_counts_);
  num_received_ = recv_offsets_.back();

  const auto graph = [comm](const std::vector<int>& sources, const std::vector<int>& targets)
  {
    MPI_Comm out;
    MPI_Dist_graph_create_adjacent(comm, static_cast<int>(sources.size()), sources.data(),
                                   MPI_UNWEIGHTED, static_cast<int>(targets.size()), targets.data(),
                                   MPI_UNWEIGHTED, MPI_INFO_NULL, false, &out);
    return out;
  };
  forward_comm_ = graph(from, to);
  reverse_comm_ = graph(to, from);
}

Exchange::~Exchange()
{
  MPI_Comm_free(&forward_comm_);
  MPI_Comm_free(&reverse_comm_);
}

void Exchange::send(const void* in, void* out, std::size_t record_bytes, bool forward) const
{
  // One MPI element per record keeps counts and offsets within int for any record width.
  MPI_Datatype record;
  MPI_Type_contiguous(static_cast<int>(record_bytes), MPI_BYTE, &record);
  MPI_Type_commit(&record);
  if (forward)
    MPI_Neighbor_alltoallv(in, send_counts_.data(), send_offsets_.data(), record, out,
                           recv_counts_.data(), recv_offsets_.data(), record, forward_comm_);
  else
    MPI_Neighbor_alltoallv(in, recv_counts_.data(), recv_offsets_.data(), record, out,
                           send_counts_.data(), send_offsets_.data(), record, reverse_comm_);
  MPI_Type_free(&record);
}

std::vector<double> qsdolfinx::all_bounding_boxes(MPI_Comm comm, std::span<const double> points)
{
  constexpr double inf = std::numeric_limits<double>::infinity();
  std::array<double, 6> box{inf, inf, inf, -inf, -inf, -inf};
  for (std::size_t i = 0; i < points.size(); i += 3)
  {
    for (std::size_t j = 0; j < 3; ++j)
    {
      box[j] = std::min(box[j], points[i + j]);
      box[3 + j] = std::max(box[3 + j], points[i + j]);
    }
  }
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<double> boxes(static_cast<std::size_t>(size) * 6);
  MPI_Allgather(box.data(), 6, MPI_DOUBLE, boxes.data(), 6, MPI_DOUBLE, comm);
  return boxes;
}
