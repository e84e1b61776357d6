#include "parallel/exchange.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <numeric>
#include <tuple>

using namespace qsdolfinx;

namespace
{
/// Numbers of records that other ranks will send to this one. Collective.
std::map<int, int> discover_sources(MPI_Comm comm, const std::map<int, int>& counts_to)
{
  std::vector<PetscMPIInt> ranks, counts;
  for (const auto& [rank, count] : counts_to)
  {
    ranks.push_back(rank);
    counts.push_back(count);
  }
  PetscMPIInt num_sources = 0, *sources = nullptr, *received = nullptr;
  check(PetscCommBuildTwoSided(comm, 1, MPI_INT, static_cast<PetscMPIInt>(ranks.size()),
                               ranks.data(), counts.data(), &num_sources, &sources, &received));
  std::map<int, int> counts_from;
  for (PetscMPIInt i = 0; i < num_sources; ++i)
    counts_from[sources[i]] = received[i];
  check(PetscFree(sources));
  check(PetscFree(received));
  return counts_from;
}
} // namespace

Exchange::Exchange(MPI_Comm comm, std::span<const int> dest) : order_(dest.size())
{
  check(PetscCommDuplicate(comm, &comm_, &tag_));
  std::iota(order_.begin(), order_.end(), 0);
  std::stable_sort(order_.begin(), order_.end(), [&](auto a, auto b) { return dest[a] < dest[b]; });
  std::map<int, int> counts_to;
  for (int rank : dest)
    ++counts_to[rank];
  to_ = peers(counts_to);
  from_ = peers(discover_sources(comm_, counts_to));
  for (const Peer& peer : from_)
    num_received_ += static_cast<std::size_t>(peer.count);
}

Exchange::~Exchange()
{
  if (petsc_is_running())
    std::ignore = PetscCommDestroy(&comm_);
}

std::vector<Exchange::Peer> Exchange::peers(const std::map<int, int>& counts)
{
  std::vector<Peer> out;
  std::size_t offset = 0;
  for (const auto& [rank, count] : counts)
  {
    out.push_back({rank, count, offset});
    offset += static_cast<std::size_t>(count);
  }
  return out;
}

void Exchange::send(const void* in, const std::vector<Peer>& targets, void* out,
                    const std::vector<Peer>& sources, std::size_t record_bytes) const
{
  // One MPI element per record keeps counts within int for any record width.
  MPI_Datatype record;
  MPI_Type_contiguous(static_cast<int>(record_bytes), MPI_BYTE, &record);
  MPI_Type_commit(&record);
  std::vector<MPI_Request> requests(sources.size() + targets.size());
  std::size_t i = 0;
  for (const Peer& p : sources)
    MPI_Irecv(static_cast<char*>(out) + p.offset * record_bytes, p.count, record, p.rank, tag_,
              comm_, &requests[i++]);
  for (const Peer& p : targets)
    MPI_Isend(static_cast<const char*>(in) + p.offset * record_bytes, p.count, record, p.rank, tag_,
              comm_, &requests[i++]);
  MPI_Waitall(static_cast<int>(requests.size()), requests.data(), MPI_STATUSES_IGNORE);
  MPI_Type_free(&record);
}
