() => {
  const found = [];
  const width = document.documentElement.clientWidth;
  for (const element of document.querySelectorAll('h1, h2, p, li, summary, figcaption, caption, th, td, .scroll, .picture')) {
    const box = element.getBoundingClientRect();
    if (!box.width) continue;
    const scrolls = element.matches('.scroll, .picture');
    const inside = element.closest('.scroll, .picture');
    if (!scrolls && element.scrollWidth > element.clientWidth + 1 && getComputedStyle(element).display !== 'inline')
      found.push(['text outside ' + element.tagName, element.textContent.slice(0, 80)]);
    if ((scrolls || !inside) && box.right > width + 1) found.push(['outside the page', element.textContent.slice(0, 80)]);
  }
  if (document.documentElement.scrollWidth > width) found.push(['the page scrolls sideways', '']);
  return found;
}
