// Tables: a click on a heading sorts the rows by its column, a second one the other way round.

function sortRows(heading) {
  const table = heading.closest('table');
  const column = heading.cellIndex;
  const descending = heading.getAttribute('aria-sort') === 'ascending';
  for (const other of table.querySelectorAll('[aria-sort]')) other.removeAttribute('aria-sort');
  heading.setAttribute('aria-sort', descending ? 'descending' : 'ascending');
  const value = (row) => row.cells[column].dataset.value;
  const compare = (one, other) => {
    const [a, b] = [value(one), value(other)];
    if (a === '' || b === '') return (a === '') - (b === ''); // what is missing comes last
    const numbers = Number(a) - Number(b);
    return (Number.isNaN(numbers) ? a.localeCompare(b) : numbers) * (descending ? -1 : 1);
  };
  const body = table.tBodies[0];
  body.append(...[...body.rows].sort(compare));
}

for (const button of document.querySelectorAll('.sortable thead button')) {
  button.addEventListener('click', () => sortRows(button.closest('th')));
}
